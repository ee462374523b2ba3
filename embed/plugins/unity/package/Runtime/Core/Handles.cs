using System;
using System.Runtime.InteropServices;

namespace Surefoot
{
    /// <summary>A pointer that the library destroys once: when its owner is disposed, or when the garbage collector finds it.</summary>
    internal abstract class NativeHandle : SafeHandle
    {
        protected NativeHandle()
            : base(IntPtr.Zero, true)
        {
        }

        public override bool IsInvalid => handle == IntPtr.Zero;

        protected abstract void Destroy(IntPtr pointer);

        protected override bool ReleaseHandle()
        {
            Destroy(handle);
            return true;
        }
    }

    internal sealed class PolicyHandle : NativeHandle
    {
        protected override void Destroy(IntPtr pointer) => NativeMethods.sf_policy_destroy(pointer);
    }

    internal sealed class AgentsHandle : NativeHandle
    {
        protected override void Destroy(IntPtr pointer) => NativeMethods.sf_agents_destroy(pointer);
    }

    internal sealed class GraphHandle : NativeHandle
    {
        protected override void Destroy(IntPtr pointer) => NativeMethods.sf_graph_destroy(pointer);
    }

    internal sealed class FollowerHandle : NativeHandle
    {
        protected override void Destroy(IntPtr pointer) => NativeMethods.sf_follower_destroy(pointer);
    }

    internal sealed class RehearsalsHandle : NativeHandle
    {
        protected override void Destroy(IntPtr pointer) => NativeMethods.sf_rehearsals_destroy(pointer);
    }

    internal sealed class MapHandle : NativeHandle
    {
        protected override void Destroy(IntPtr pointer) => NativeMethods.sf_map_destroy(pointer);
    }

    internal sealed class WorldHandle : NativeHandle
    {
        protected override void Destroy(IntPtr pointer) => NativeMethods.sf_world_destroy(pointer);
    }

    internal sealed class SnapshotHandle : NativeHandle
    {
        protected override void Destroy(IntPtr pointer) => NativeMethods.sf_snapshot_destroy(pointer);
    }
}
