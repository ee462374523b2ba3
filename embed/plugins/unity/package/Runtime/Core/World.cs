using System;
using System.Runtime.InteropServices;

namespace Surefoot
{
    /// <summary>
    /// The simulation that policies were trained in, for tests and rollbacks: a game in Unity moves its characters itself. One thread at a
    /// time.
    /// </summary>
    public sealed unsafe class World : IDisposable
    {
        public const int TicksPerSecond = 60;
        public const int TicksPerDecision = 10;

        private readonly WorldHandle handle;

        /// <summary>A world without NPCs, for bodies that policies were trained with.</summary>
        public World(Map map)
            : this(map, Body.Default)
        {
        }

        /// <summary>A world without NPCs.</summary>
        public World(Map map, Body body)
        {
            Native.CheckGiven(nameof(map), map);
            NativeError error;
            body.StructSize = (uint)sizeof(Body);
            Native.Check(NativeMethods.sf_world_create(map.Handle, &body, out handle, &error), &error);
        }

        /// <summary>Adds an NPC at rest, and returns its number.</summary>
        public uint Spawn(Vec3 feet, float yaw)
        {
            NativeError error;
            uint npc;
            Native.Check(NativeMethods.sf_world_spawn(handle, feet, yaw, &npc, &error), &error);
            return npc;
        }

        /// <summary>Removes an NPC; its number is used again.</summary>
        public void Despawn(uint npc)
        {
            NativeError error;
            Native.Check(NativeMethods.sf_world_despawn(handle, npc, &error), &error);
        }

        /// <summary>Starts an attempt at a goal; the body keeps its motion.</summary>
        public void SetGoal(uint npc, Vec3 goal)
        {
            NativeError error;
            Native.Check(NativeMethods.sf_world_set_goal(handle, npc, goal, &error), &error);
        }

        /// <summary>Begins a decision: the action is held until the next one.</summary>
        public void Decide(uint npc, AgentAction action)
        {
            NativeError error;
            Native.Check(NativeMethods.sf_world_decide(handle, npc, action, &error), &error);
        }

        /// <summary>Moves everything by 1/60 s, and returns the number of ticks so far.</summary>
        public ulong Tick()
        {
            NativeError error;
            ulong tick;
            Native.Check(NativeMethods.sf_world_tick(handle, &tick, &error), &error);
            return tick;
        }

        /// <summary>Ends a decision of an NPC that has a goal.</summary>
        public Outcome CloseDecision(uint npc)
        {
            NativeError error;
            Outcome outcome;
            Native.Check(NativeMethods.sf_world_close_decision(handle, npc, &outcome, &error), &error);
            return outcome;
        }

        /// <summary>A whole decision of NPCs, each with a goal: decides, ticks ten times, closes.</summary>
        public void Step(ReadOnlySpan<uint> npcs, ReadOnlySpan<AgentAction> actions, Span<Outcome> outcomes)
        {
            NativeError error;
            Native.CheckLength(nameof(actions), actions.Length, npcs.Length);
            Native.CheckLength(nameof(outcomes), outcomes.Length, npcs.Length);
            fixed (uint* firstNpc = &MemoryMarshal.GetReference(npcs))
            fixed (AgentAction* firstAction = &MemoryMarshal.GetReference(actions))
            fixed (Outcome* firstOutcome = &MemoryMarshal.GetReference(outcomes))
            {
                Native.Check(
                    NativeMethods.sf_world_step(handle, firstNpc, firstAction, firstOutcome, Native.Size(npcs.Length), &error), &error);
            }
        }

        /// <summary>The state of an NPC, as agents observe it.</summary>
        public CharacterState State(uint npc)
        {
            NativeError error;
            CharacterState state = new CharacterState { StructSize = (uint)sizeof(CharacterState) };
            Native.Check(NativeMethods.sf_world_state(handle, npc, &state, &error), &error);
            return state;
        }

        /// <summary>What the <see cref="Agents.RayCount"/> rays of an NPC end on.</summary>
        public void Look(uint npc, Span<SightHit> hits)
        {
            NativeError error;
            fixed (SightHit* first = &MemoryMarshal.GetReference(hits))
            {
                Native.Check(NativeMethods.sf_world_look(handle, npc, first, Native.Size(hits.Length), &error), &error);
            }
        }

        /// <summary>Casts any rays at the map, up to <see cref="Agents.RayRange"/>.</summary>
        public void CastRays(ReadOnlySpan<SightRay> rays, Span<SightHit> hits)
        {
            NativeError error;
            Native.CheckLength(nameof(hits), hits.Length, rays.Length);
            fixed (SightRay* firstRay = &MemoryMarshal.GetReference(rays))
            fixed (SightHit* firstHit = &MemoryMarshal.GetReference(hits))
            {
                Native.Check(NativeMethods.sf_world_cast_rays(handle, firstRay, Native.Size(rays.Length), firstHit, &error), &error);
            }
        }

        /// <summary>The observation of an NPC as the simulation writes it.</summary>
        public float[] Observation(uint npc) =>
            Native.All<float>((items, capacity, count, error) =>
                NativeMethods.sf_world_observation(handle, npc, (float*)items, capacity, count, error));

        /// <summary>Copies the state of the world, all NPCs included, over what the snapshot holds.</summary>
        public void Save(Snapshot snapshot)
        {
            Native.CheckGiven(nameof(snapshot), snapshot);
            NativeError error;
            Native.Check(NativeMethods.sf_world_save(handle, snapshot.Handle, &error), &error);
        }

        /// <summary>Restores a snapshot of this world or of another on the same map; the same actions then lead to the same bits.</summary>
        public void Restore(Snapshot snapshot)
        {
            Native.CheckGiven(nameof(snapshot), snapshot);
            NativeError error;
            Native.Check(NativeMethods.sf_world_restore(handle, snapshot.Handle, &error), &error);
        }

        public void Dispose() => handle.Dispose();
    }

    /// <summary>A copy of the state of a <see cref="World"/>, to be used over and over.</summary>
    public sealed unsafe class Snapshot : IDisposable
    {
        private readonly SnapshotHandle handle;

        /// <summary>An empty snapshot.</summary>
        public Snapshot()
        {
            Library.RequireLoaded();
            NativeError error;
            Native.Check(NativeMethods.sf_snapshot_create(out handle, &error), &error);
        }

        internal SnapshotHandle Handle => handle;

        public void Dispose() => handle.Dispose();
    }
}
