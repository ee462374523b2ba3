using System;
using System.Runtime.InteropServices;

namespace Surefoot
{
    /// <summary>
    /// Runs the next legs of plans in a copy of the level, ahead of agents with one policy and body. <see cref="Attempt"/> uses them: its NPC then
    /// moves calmly where a rehearsal has arrived, and takes another route where rehearsals come to harm.
    /// </summary>
    public sealed unsafe class Rehearsals : IDisposable
    {
        /// <summary>
        /// Prepares rehearsals for the agents that have this policy and body. They run on threads of their own, at most 64; with 0 threads they run
        /// in the calls of <see cref="Attempt.Advance"/>, and repeat themselves.
        /// </summary>
        public Rehearsals(Policy policy, Map map, Body body, uint threadCount = 1)
        {
            Native.CheckGiven(nameof(policy), policy);
            Native.CheckGiven(nameof(map), map);
            NativeError error;
            RehearsalsHandle handle;
            body.StructSize = (uint)sizeof(Body);
            Native.Check(NativeMethods.sf_rehearsals_create(policy.Handle, map.Handle, &body, threadCount, out handle, &error), &error);
            Handle = handle;
        }

        /// <summary>
        /// Puts exactly these blocks into the copies of the level, at most 1024. NPCs then take another plan, and avoid legs on which a block stops
        /// their rehearsals.
        /// </summary>
        public void SetBlocks(ReadOnlySpan<Block> blocks)
        {
            NativeError error;
            fixed (Block* first = &MemoryMarshal.GetReference(blocks))
            {
                Native.Check(NativeMethods.sf_rehearsals_set_blocks(Handle, first, Native.Size(blocks.Length), &error), &error);
            }
        }

        internal RehearsalsHandle Handle { get; }

        /// <summary>Waits for the rehearsals that run. Attempts must have ended.</summary>
        public void Dispose() => Handle.Dispose();
    }
}
