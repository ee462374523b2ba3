using System;
using System.Linq;

namespace Surefoot.Tests
{
    internal static class AgentsTests
    {
        private const int Count = 64;

        /// <summary>NPCs of the simulation, each with an agent that has the same goal.</summary>
        private sealed class Crowd : IDisposable
        {
            internal readonly World World;
            internal readonly Agents Agents;
            internal readonly uint[] Npcs;
            internal readonly CharacterState[] States;
            internal readonly SightRay[] Rays;
            internal readonly SightHit[] Hits;

            internal Crowd(Files files, int count)
            {
                using (Map map = Map.Load(files.Level))
                using (Policy policy = Policy.Shipped())
                using (Graph graph = Graph.Load(files.Graph))
                {
                    World = new World(map);
                    Agents = new Agents(policy, (uint)count);
                    Agents.SetDevices(map.Devices());
                    Vec3[] places = graph.Vertices();
                    Npcs = Enumerable.Range(0, count).Select(idx => World.Spawn(places[idx], idx)).ToArray();
                    for (int idx = 0; idx < count; idx++)
                    {
                        Vec3 goal = places[places.Length - 1 - idx];
                        World.SetGoal(Npcs[idx], goal);
                        Agents.Begin((uint)idx, (ulong)idx);
                        Agents.SetGoal((uint)idx, places[idx], goal);
                    }
                }
                States = new CharacterState[count];
                Rays = new SightRay[count * Agents.RayCount];
                Hits = new SightHit[Rays.Length];
            }

            internal void Observe()
            {
                for (int idx = 0; idx < Npcs.Length; idx++)
                {
                    States[idx] = World.State(Npcs[idx]);
                }
                Agents.Rays(States, Rays);
                World.CastRays(Rays, Hits);
                Agents.Observe(default(ReadOnlySpan<uint>), States, Hits);
            }

            public void Dispose()
            {
                Agents.Dispose();
                World.Dispose();
            }
        }

        internal static void ObserveWhatTheSimulationObserves(Files files)
        {
            using (Crowd crowd = new Crowd(files, Count))
            {
                crowd.Observe();
                float[] seen = new float[461];
                SightHit[] look = new SightHit[Agents.RayCount];
                for (uint idx = 0; idx < Count; idx++)
                {
                    crowd.World.Look(crowd.Npcs[idx], look);
                    for (int ray = 0; ray < look.Length; ray++)
                    {
                        SightHit found = crowd.Hits[idx * Agents.RayCount + ray];
                        Expect.Equal(found.Surface, look[ray].Surface, $"what ray {ray} of NPC {idx} ends on");
                        Expect.Near(found.Distance, look[ray].Distance, 1e-3f, $"the length of ray {ray} of NPC {idx}");
                    }
                    crowd.Agents.Observe(new[] { idx }, new[] { crowd.States[idx] }, look);
                    int length = crowd.Agents.Observation(idx, seen);
                    Expect.That(seen.Take(length).SequenceEqual(crowd.World.Observation(crowd.Npcs[idx])), $"observation {idx}");
                }
            }
        }

        internal static void DecideTogetherAsAlone(Files files)
        {
            using (Crowd crowd = new Crowd(files, Count))
            {
                AgentAction[] together = new AgentAction[Count];
                AgentAction[] alone = new AgentAction[1];
                for (int decision = 0; decision < 5; decision++)
                {
                    crowd.Observe();
                    byte[][] before = Enumerable.Range(0, Count).Select(idx => crowd.Agents.Save((uint)idx)).ToArray();
                    crowd.Agents.Decide(default(ReadOnlySpan<uint>), together);
                    for (uint idx = 0; idx < Count; idx++)
                    {
                        byte[] after = crowd.Agents.Save(idx);
                        crowd.Agents.Restore(idx, before[idx]);
                        crowd.Agents.Decide(new[] { idx }, alone);
                        Expect.Equal(alone[0], together[idx], $"the action of agent {idx}");
                        Expect.That(crowd.Agents.Save(idx).SequenceEqual(after), $"the memory of agent {idx}");
                    }
                    Expect.That(together.All(InRange), "actions are -1 to 1");
                    crowd.World.Step(crowd.Npcs, together, new Outcome[Count]);
                }
                Expect.That(together.Distinct().Count() > Count / 2, "agents at different places do different things");
            }
        }

        /// <summary>
        /// The script sets a nursery of 1 MB for the garbage collector, so that the smallest object in each call would start a collection.
        /// </summary>
        internal static void AllocateNothing(Files files)
        {
            const int calls = 100000;
            using (Crowd crowd = new Crowd(files, 1))
            {
                AgentAction[] actions = new AgentAction[1];
                crowd.Observe();
                Expect.That(Collections(calls, () => GC.KeepAlive(new object())) > 0, "this test notices objects");
                CastRays cast = crowd.World.CastRays;
                int collections = Collections(calls, () =>
                {
                    crowd.Agents.HasArrived(crowd.States[0], crowd.States[0].Feet, 1, cast);
                    crowd.Agents.Note(0, crowd.States[0].Feet);
                    crowd.Agents.Rays(crowd.States, crowd.Rays);
                    crowd.Agents.Observe(default(ReadOnlySpan<uint>), crowd.States, crowd.Hits);
                    crowd.Agents.Decide(default(ReadOnlySpan<uint>), actions);
                });
                Expect.Equal(collections, 0, "the number of collections");
            }
        }

        internal static void PoliciesAreDescribed()
        {
            using (Policy reactive = Policy.Shipped())
            using (Policy recurrent = Policy.Shipped("general-lstm"))
            {
                Expect.That(reactive.Label.StartsWith("general-reactive ("), reactive.Label);
                Expect.Equal(reactive.ObservationLength, 369, "the length of observations");
                Expect.Equal(reactive.MemoryLength, 0, "the memory of a reactive policy");
                Expect.That(recurrent.MemoryLength > 0, "a recurrent policy has a memory");
            }
        }

        private static int Collections(int calls, Action call)
        {
            call();
            GC.Collect();
            int before = GC.CollectionCount(0);
            for (int idx = 0; idx < calls; idx++)
            {
                call();
            }
            return GC.CollectionCount(0) - before;
        }

        private static bool InRange(AgentAction action) =>
            new[] { action.Forward, action.Strafe, action.Turn, action.Jump }.All(value => value >= -1 && value <= 1);
    }
}
