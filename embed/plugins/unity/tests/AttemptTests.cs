using System;
using System.Linq;

namespace Surefoot.Tests
{
    internal static class AttemptTests
    {
        private const int MostDecisions = 1500;

        /// <summary>An NPC of the simulation with its agent, as a game has characters.</summary>
        private sealed class Walker : IDisposable
        {
            private readonly World world;
            private readonly Agents agents;
            private readonly CharacterState[] states = new CharacterState[1];
            private readonly SightRay[] rays = new SightRay[Agents.RayCount];
            private readonly SightHit[] hits = new SightHit[Agents.RayCount];
            private readonly AgentAction[] actions = new AgentAction[1];
            private readonly uint npc;

            internal Walker(Map map, Vec3 start, ulong seed)
            {
                using (Policy policy = Policy.Shipped())
                {
                    agents = new Agents(policy, 1);
                }
                agents.SetDevices(map.Devices());
                agents.Begin(0, seed);
                world = new World(map);
                npc = world.Spawn(start, 0);
            }

            internal Vec3 Feet => world.State(npc).Feet;

            internal Attempt Begin(Graph graph, Vec3 goal) => new Attempt(agents, 0, graph, Feet, goal);

            /// <summary>Decides and moves until the attempt ends. Returns the number of decisions.</summary>
            internal int Walk(Attempt attempt)
            {
                int decisions = 0;
                while (decisions < MostDecisions && attempt.Advance(Feet) == AttemptState.GoesOn)
                {
                    states[0] = world.State(npc);
                    agents.Rays(states, rays);
                    world.CastRays(rays, hits);
                    agents.Observe(default(ReadOnlySpan<uint>), states, hits);
                    agents.Decide(default(ReadOnlySpan<uint>), actions);
                    world.Decide(npc, actions[0]);
                    for (int tick = 0; tick < World.TicksPerDecision; tick++)
                    {
                        world.Tick();
                        attempt.Note(Feet);
                    }
                    decisions++;
                }
                return decisions;
            }

            public void Dispose()
            {
                agents.Dispose();
                world.Dispose();
            }
        }

        internal static void WalksByPlan(Files files)
        {
            const int goals = 8;
            int arrived = 0;
            using (Map map = Map.Load(files.Level))
            using (Graph graph = Graph.Load(files.Graph))
            {
                Vec3[] places = graph.Vertices();
                for (int idx = 0; idx < goals; idx++)
                {
                    Vec3 goal = places[(idx * 7 + places.Length / 2) % places.Length];
                    using (Walker walker = new Walker(map, places[idx * 7], (ulong)idx))
                    using (Attempt attempt = walker.Begin(graph, goal))
                    {
                        int decisions = walker.Walk(attempt);
                        bool isThere = attempt.State == AttemptState.Reached;
                        Expect.Equal((walker.Feet - goal).Length <= Agents.ReachedWithin, isThere, "whether the NPC is at its goal");
                        Console.WriteLine($"        goal {idx}: {attempt.State} after {decisions * Agents.DecisionSeconds:0.0} s");
                        arrived += isThere ? 1 : 0;
                    }
                }
            }
            Expect.That(arrived * 4 >= goals * 3, $"{arrived} of {goals} arrived");
        }

        internal static void WalksStraight(string square)
        {
            using (Map map = Map.Load(square))
            using (Walker walker = new Walker(map, map.Origin, 3))
            using (Attempt attempt = walker.Begin(null, map.Origin + new Vec3(12, 0, -9)))
            {
                walker.Walk(attempt);
                Expect.Equal(attempt.State, AttemptState.Reached, "the end of an attempt");
                Expect.Equal(attempt.Legs.Length, 0, "the number of legs without a plan");
            }
        }

        internal static void Ends(Files files)
        {
            using (Map map = Map.Load(files.Level))
            using (Graph graph = Graph.Load(files.Graph))
            {
                Vec3 start = graph.Vertices()[0];
                using (Walker walker = new Walker(map, start, 1))
                using (Attempt attempt = walker.Begin(graph, graph.Vertices()[50]))
                {
                    attempt.Advance(walker.Feet);
                    Expect.That(attempt.Legs.Length > 0, "a plan has legs");
                    attempt.NoteDeath();
                    Expect.Equal(attempt.Advance(walker.Feet), AttemptState.GaveUp, "an attempt after a death");
                }
                using (Walker walker = new Walker(map, start, 1))
                using (Attempt attempt = walker.Begin(graph, start + new Vec3(0, 25, 0)))
                {
                    walker.Walk(attempt);
                    Console.WriteLine("        a goal in the air: " + attempt.State);
                    Expect.That(attempt.State == AttemptState.Unreachable || attempt.State == AttemptState.GaveUp, "the attempt has failed");
                }
            }
        }

        internal static void SnapshotRestores(Files files)
        {
            using (Map map = Map.Load(files.Level))
            using (Graph graph = Graph.Load(files.Graph))
            using (World world = new World(map))
            using (Snapshot snapshot = new Snapshot())
            {
                uint npc = world.Spawn(graph.Vertices()[0], 0);
                world.Decide(npc, new AgentAction { Forward = 1 });
                world.Save(snapshot);
                world.Tick();
                CharacterState once = world.State(npc);
                world.Restore(snapshot);
                world.Tick();
                Expect.Equal(world.State(npc), once, "the state after a tick");
            }
        }
    }
}
