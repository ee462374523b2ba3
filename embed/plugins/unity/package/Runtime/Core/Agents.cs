using System;
using System.Runtime.InteropServices;

namespace Surefoot
{
    /// <summary>Casts rays in the game's physics: fills a hit for each. Rays should pass through characters.</summary>
    public delegate void CastRays(ReadOnlySpan<SightRay> rays, Span<SightHit> hits);

    /// <summary>
    /// The minds of characters with equal bodies. Every 1/6 s, for any number of them together: <see cref="Rays"/>, casts in the game's
    /// physics, <see cref="Observe"/>, <see cref="Decide"/>.
    /// </summary>
    /// <remarks>
    /// Nothing is allocated after construction, but by <see cref="SetDevices"/> and for exceptions. One thread at a time; another gets
    /// <see cref="Status.Busy"/>. `ids` are numbers of agents, each at most once; an empty span stands for 0, 1, 2 and so on.
    /// </remarks>
    public sealed unsafe class Agents : IDisposable
    {
        /// <summary>Rays of an agent.</summary>
        public const int RayCount = 64;
        /// <summary>Reach of every ray, m.</summary>
        public const float RayRange = 30;
        /// <summary>Distance from a waypoint at which it is reached, and the usual radius of goals, m.</summary>
        public const float ReachedWithin = 1;
        /// <summary>Seconds between two decisions.</summary>
        public const float DecisionSeconds = 1f / 6;
        /// <summary>Share of its exploration noise with which a policy does best.</summary>
        public const float DefaultNoise = 0.5f;
        /// <summary>Decisions without coming closer after which an attempt without a plan is hopeless.</summary>
        public const uint HopelessAfter = 300;

        /// <summary>Rays from a character to its goal.</summary>
        private const int ArrivalRayCount = 2;

        private readonly AgentsHandle handle;
        private readonly SightRay[] arrivalRays = new SightRay[ArrivalRayCount];
        private readonly SightHit[] arrivalHits = new SightHit[ArrivalRayCount];

        /// <summary>Makes room for agents, 1 to 65536, with the body that policies were trained with.</summary>
        public Agents(Policy policy, uint maxAgents)
            : this(policy, maxAgents, Body.Default)
        {
        }

        /// <summary>Makes room for agents, 1 to 65536, with bodies of their own.</summary>
        public Agents(Policy policy, uint maxAgents, Body body)
        {
            Native.CheckGiven(nameof(policy), policy);
            NativeError error;
            body.StructSize = (uint)sizeof(Body);
            Native.Check(NativeMethods.sf_agents_create(policy.Handle, &body, maxAgents, out handle, &error), &error);
        }

        internal AgentsHandle Handle => handle;

        /// <summary>Replaces the devices of the level, at most 20000, which agents sense within 50 m.</summary>
        public void SetDevices(ReadOnlySpan<Device> devices)
        {
            NativeError error;
            fixed (Device* first = &MemoryMarshal.GetReference(devices))
            {
                Native.Check(NativeMethods.sf_agents_set_devices(handle, first, Native.Size(devices.Length), &error), &error);
            }
        }

        /// <summary>Makes an agent forget everything, its goal too: for a character that was just spawned. The seed decides its noise.</summary>
        public void Begin(uint agent, ulong seed)
        {
            NativeError error;
            Native.Check(NativeMethods.sf_agents_begin(handle, agent, seed, &error), &error);
        }

        /// <summary>
        /// Gives an agent a goal or the next waypoint, between decisions, also in every one. What it remembers stays, and its progress starts
        /// again.
        /// </summary>
        public void SetGoal(uint agent, Vec3 feet, Vec3 goal)
        {
            NativeError error;
            Native.Check(NativeMethods.sf_agents_set_goal(handle, agent, feet, goal, &error), &error);
        }

        /// <summary>
        /// Tells, every tick, where an agent is between decisions. Returns whether it has come within <see
        /// cref="ReachedWithin"/> of its goal, also in flight.
        /// </summary>
        public bool Note(uint agent, Vec3 feet)
        {
            NativeError error;
            int reached;
            Native.Check(NativeMethods.sf_agents_note(handle, agent, feet, &reached, &error), &error);
            return reached != 0;
        }

        /// <summary>
        /// Whether a character has arrived at a goal: it stands within the radius, 0 to 30 m, no higher or lower than
        /// steps and slopes take it, and nothing solid is between. Ask in every tick. Casts two rays, and only if all
        /// else is so; null for `cast`: nothing is between.
        /// </summary>
        public bool HasArrived(in CharacterState state, Vec3 goal, float radius, CastRays cast)
        {
            NativeError error;
            UIntPtr count;
            int arrived;
            CharacterState sized = state;
            sized.StructSize = (uint)sizeof(CharacterState);
            fixed (SightRay* ray = arrivalRays)
            fixed (SightHit* hit = arrivalHits)
            {
                UIntPtr room = Native.Size(ArrivalRayCount);
                Status status =
                    NativeMethods.sf_agents_arrival_rays(handle, &sized, goal, radius, ray, room, &count, &error);
                Native.Check(status, &error);
                if ((int)count == 0 || cast == null)
                {
                    return (int)count > 0;
                }
                cast(arrivalRays, arrivalHits);
                status = NativeMethods.sf_agents_has_arrived(handle, &sized, goal, radius, hit, &arrived, &error);
                Native.Check(status, &error);
            }
            return arrived != 0;
        }

        /// <summary>Fills `rays` with those of the characters, <see cref="RayCount"/> for each.</summary>
        public void Rays(Span<CharacterState> states, Span<SightRay> rays)
        {
            NativeError error;
            SetSizes(states);
            Native.CheckLength(nameof(rays), rays.Length, states.Length * RayCount);
            fixed (CharacterState* firstState = &MemoryMarshal.GetReference(states))
            fixed (SightRay* firstRay = &MemoryMarshal.GetReference(rays))
            {
                Native.Check(
                    NativeMethods.sf_agents_rays(handle, firstState, Native.Size(states.Length), firstRay, Native.Size(rays.Length), &error),
                    &error);
            }
        }

        /// <summary>Observes agents: a state for each, and what its <see cref="RayCount"/> rays ended on.</summary>
        public void Observe(ReadOnlySpan<uint> ids, Span<CharacterState> states, ReadOnlySpan<SightHit> hits)
        {
            NativeError error;
            SetSizes(states);
            Native.CheckIds(ids, states.Length);
            Native.CheckLength(nameof(hits), hits.Length, states.Length * RayCount);
            fixed (uint* firstId = &MemoryMarshal.GetReference(ids))
            fixed (CharacterState* firstState = &MemoryMarshal.GetReference(states))
            fixed (SightHit* firstHit = &MemoryMarshal.GetReference(hits))
            {
                Native.Check(
                    NativeMethods.sf_agents_observe(
                        handle, ids.IsEmpty ? null : firstId, firstState, firstHit, Native.Size(states.Length), &error),
                    &error);
            }
        }

        /// <summary>Copies the last observation of an agent, and returns its length.</summary>
        public int Observation(uint agent, Span<float> values)
        {
            NativeError error;
            UIntPtr count;
            fixed (float* first = &MemoryMarshal.GetReference(values))
            {
                Native.Check(NativeMethods.sf_agents_observation(handle, agent, first, Native.Size(values.Length), &count, &error), &error);
            }
            return (int)count;
        }

        /// <summary>
        /// Decides for agents that were observed, by the policy's mean plus this share, 0 to 1, of its exploration noise. To the bit, what an
        /// agent does does not depend on who decides together with it.
        /// </summary>
        public void Decide(ReadOnlySpan<uint> ids, Span<AgentAction> actions, float noiseShare = DefaultNoise)
        {
            NativeError error;
            Native.CheckIds(ids, actions.Length);
            fixed (uint* firstId = &MemoryMarshal.GetReference(ids))
            fixed (AgentAction* firstAction = &MemoryMarshal.GetReference(actions))
            {
                Native.Check(
                    NativeMethods.sf_agents_decide(
                        handle, ids.IsEmpty ? null : firstId, Native.Size(actions.Length), noiseShare, firstAction, &error),
                    &error);
            }
        }

        /// <summary>Reports characters whose action differs from the decision.</summary>
        public void Acted(ReadOnlySpan<uint> ids, ReadOnlySpan<AgentAction> actions)
        {
            NativeError error;
            Native.CheckIds(ids, actions.Length);
            fixed (uint* firstId = &MemoryMarshal.GetReference(ids))
            fixed (AgentAction* firstAction = &MemoryMarshal.GetReference(actions))
            {
                Native.Check(
                    NativeMethods.sf_agents_acted(handle, ids.IsEmpty ? null : firstId, firstAction, Native.Size(actions.Length), &error),
                    &error);
            }
        }

        public Progress ProgressOf(uint agent)
        {
            NativeError error;
            Progress progress = new Progress { StructSize = (uint)sizeof(Progress) };
            Native.Check(NativeMethods.sf_agents_progress(handle, agent, &progress, &error), &error);
            return progress;
        }

        /// <summary>Copies all that an agent knows, for rollbacks and saved games; for the same library and policy.</summary>
        public byte[] Save(uint agent) =>
            Native.All<byte>((items, capacity, count, error) => NativeMethods.sf_agents_save(handle, agent, items, capacity, count, error));

        /// <summary>The same without allocation. Returns the number of bytes.</summary>
        public int Save(uint agent, Span<byte> bytes)
        {
            NativeError error;
            UIntPtr size;
            fixed (byte* first = &MemoryMarshal.GetReference(bytes))
            {
                Native.Check(NativeMethods.sf_agents_save(handle, agent, first, Native.Size(bytes.Length), &size, &error), &error);
            }
            return (int)size;
        }

        /// <summary>Restores what <see cref="Save(uint)"/> copied.</summary>
        public void Restore(uint agent, ReadOnlySpan<byte> bytes)
        {
            NativeError error;
            fixed (byte* first = &MemoryMarshal.GetReference(bytes))
            {
                Native.Check(NativeMethods.sf_agents_restore(handle, agent, first, Native.Size(bytes.Length), &error), &error);
            }
        }

        public void Dispose() => handle.Dispose();

        private static void SetSizes(Span<CharacterState> states)
        {
            for (int idx = 0; idx < states.Length; idx++)
            {
                states[idx].StructSize = (uint)sizeof(CharacterState);
            }
        }
    }
}
