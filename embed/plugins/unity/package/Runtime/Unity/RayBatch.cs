using System;
using Unity.Collections;
using UnityEngine;

namespace Surefoot.Unity
{
    /// <summary>Casts the rays of all agents that decide together, on the threads of Unity's job system.</summary>
    internal sealed class RayBatch : IDisposable
    {
        private const int RaysPerJob = Agents.RayCount;

        private NativeArray<RaycastCommand> commands;
        private NativeArray<RaycastHit> results;

        internal RayBatch(int capacity)
        {
            commands = new NativeArray<RaycastCommand>(capacity, Allocator.Persistent);
            results = new NativeArray<RaycastHit>(capacity, Allocator.Persistent);
        }

        internal void Cast(ReadOnlySpan<SightRay> rays, Span<SightHit> hits, UnityFrame frame, SurfaceLayers surfaces)
        {
            NativeArray<RaycastCommand> asked = commands.GetSubArray(0, rays.Length);
            NativeArray<RaycastHit> found = results.GetSubArray(0, rays.Length);
            QueryParameters query = surfaces.Query();
            for (int idx = 0; idx < rays.Length; idx++)
            {
                Vector3 origin = frame.FromMap(rays[idx].Origin).ToVector3();
                Vector3 direction = UnityFrame.Mirror(rays[idx].Direction).ToVector3();
                asked[idx] = new RaycastCommand(origin, direction, query, Agents.RayRange);
            }
            RaycastCommand.ScheduleBatch(asked, found, RaysPerJob).Complete();
            for (int idx = 0; idx < rays.Length; idx++)
            {
                Collider collider = found[idx].collider;
                hits[idx] = collider == null
                    ? default(SightHit)
                    : new SightHit { Distance = found[idx].distance, Surface = surfaces.Of(collider.gameObject.layer) };
            }
        }

        public void Dispose()
        {
            commands.Dispose();
            results.Dispose();
        }
    }
}
