using System.IO;
using Surefoot.Unity;
using UnityEditor;
using UnityEditor.AssetImporters;
using UnityEngine;

namespace Surefoot.Editor
{
    /// <summary>Makes a <see cref="SurefootGraphAsset"/> of a file of `surefoot graph export --format json` that is named `.sfgraph`.</summary>
    [ScriptedImporter(1, "sfgraph")]
    public sealed class GraphImporter : ScriptedImporter
    {
        [SerializeField, Tooltip("The .glb or .obj that the graph was proved on, if the file does not say where its origin lies")]
        private Object level;

        public override void OnImportAsset(AssetImportContext context)
        {
            byte[] json = File.ReadAllBytes(context.assetPath);
            try
            {
                // What is wrong with a file shows here, and not when the game starts.
                Graph.Load(json).Dispose();
                SurefootGraphAsset asset = SurefootGraphAsset.Create(json, Origin(context, json));
                context.AddObjectToAsset("graph", asset);
                context.SetMainObject(asset);
            }
            catch (SurefootException error)
            {
                context.LogImportError($"{context.assetPath}: {error.Message}");
            }
        }

        private Vec3 Origin(AssetImportContext context, byte[] json)
        {
            if (level == null)
            {
                return LinkFile.OriginOfGraph(System.Text.Encoding.UTF8.GetString(json)) ?? default(Vec3);
            }
            string path = AssetDatabase.GetAssetPath(level);
            context.DependsOnSourceAsset(path);
            return LevelOrigin.Of(path);
        }
    }
}
