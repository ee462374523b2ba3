using System;
using UnityEngine;

namespace Surefoot.Unity
{
    /// <summary>A proved graph of a level: a file of `surefoot graph export --format json` that is named `.sfgraph`.</summary>
    public sealed class SurefootGraphAsset : ScriptableObject
    {
        [SerializeField, HideInInspector] private byte[] json = new byte[0];
        [SerializeField, HideInInspector] private Vector3 originOnMap;
        [NonSerialized] private Graph graph;

        /// <summary>The graph, which is read on first use and shared by all who use the asset.</summary>
        public Graph Graph
        {
            get
            {
                if (graph == null)
                {
                    graph = Graph.Load(json);
                }
                return graph;
            }
        }

        public UnityFrame Frame => new UnityFrame(originOnMap.ToVec3());

        /// <summary>Makes an asset of the contents of a file. `origin` is where the level's origin lies on the map, m.</summary>
        public static SurefootGraphAsset Create(byte[] json, Vec3 origin)
        {
            SurefootGraphAsset asset = CreateInstance<SurefootGraphAsset>();
            asset.json = json;
            asset.originOnMap = origin.ToVector3();
            return asset;
        }

        private void OnDisable()
        {
            graph?.Dispose();
            graph = null;
        }
    }
}
