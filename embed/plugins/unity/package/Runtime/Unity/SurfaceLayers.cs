using System;
using UnityEngine;

namespace Surefoot.Unity
{
    /// <summary>What the rays of agents hit, by layers. Characters belong on a layer that is in none of them.</summary>
    [Serializable]
    public sealed class SurfaceLayers
    {
        [Tooltip("Everything solid except characters")] public LayerMask ground = Physics.DefaultRaycastLayers;
        public LayerMask water;
        [Tooltip("Lava and everything else that kills")] public LayerMask lava;
        [Tooltip("Jump pads")] public LayerMask pads;
        [Tooltip("Upper ends of zip lines")] public LayerMask zipLines;
        public LayerMask teleporters;
        [Tooltip("Jetpacks to pick up")] public LayerMask jetpacks;
        [Tooltip("Whether triggers on these layers count, such as the surface of water")] public bool hitTriggers;

        internal QueryParameters Query()
        {
            int mask = ground | water | lava | pads | zipLines | teleporters | jetpacks;
            QueryTriggerInteraction triggers = hitTriggers ? QueryTriggerInteraction.Collide : QueryTriggerInteraction.Ignore;
            return new QueryParameters(mask, false, triggers, false);
        }

        /// <summary>What a layer is; a special surface goes before the ground, which by default has nearly all layers.</summary>
        internal Surface Of(int layer)
        {
            int bit = 1 << layer;
            return (water & bit) != 0 ? Surface.Water
                : (lava & bit) != 0 ? Surface.Lava
                : (pads & bit) != 0 ? Surface.Pad
                : (zipLines & bit) != 0 ? Surface.ZipLine
                : (teleporters & bit) != 0 ? Surface.Teleporter
                : (jetpacks & bit) != 0 ? Surface.Jetpack
                : Surface.Ground;
        }
    }
}
