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
            private readonly Rehearsals rehearsals;
            private readonly uint npc;

            internal Walker(Map map, Vec3 start, ulong seed, bool rehearses = false)
            {
                using (Policy policy = Policy.Shipped())
                {
                    agents = new Agents(policy, 1);
                    rehearsals = rehearses ? new Rehearsals(policy, map, Body.Default, 0) : null;
                }
                agents.SetDevices(map.Devices());
                agents.Begin(0, seed);
                world = new World(map);
                npc = world.Spawn(start, 0);
            }

            internal CharacterState State => world.State(npc);

            /// <summary>Decisions with a jump.</summary>
            internal int Jumps { get; private set; }

            internal Vec3 Feet => State.Feet;

            internal Attempt Begin(Graph graph, Vec3 goal) =>
                new Attempt(agents, 0, graph, Feet, goal, cast: world.CastRays) { Rehearsals = rehearsals };

            internal Attempt Begin(Vec3 goal, CastRays cast) => new Attempt(agents, 0, null, Feet, goal, cast: cast);

            /// <summary>Decides and moves until the attempt ends. Returns the number of decisions.</summary>
            internal int Walk(Attempt attempt) => Chase(attempt, null);

            /// <summary>The same for a goal that has a place at each decision.</summary>
            internal int Chase(Attempt attempt, Func<int, Vec3> goal)
            {
                int decisions = 0;
                while (decisions < MostDecisions && attempt.Advance(State) == AttemptState.GoesOn)
                {
                    if (goal != null)
                    {
                        attempt.MoveGoal(goal(decisions), Feet);
                    }
                    states[0] = State;
                    agents.Rays(states, rays);
                    world.CastRays(rays, hits);
                    agents.Observe(default(ReadOnlySpan<uint>), states, hits);
                    agents.Decide(default(ReadOnlySpan<uint>), actions);
                    world.Decide(npc, actions[0]);
                    Jumps += actions[0].Jump > 0 ? 1 : 0;
                    // An attempt may end at any tick; where the NPC goes afterwards is not part of it.
                    for (int tick = 0; tick < World.TicksPerDecision && attempt.State == AttemptState.GoesOn; tick++)
                    {
                        world.Tick();
                        attempt.Note(State);
                    }
                    decisions++;
                }
                return decisions;
            }

            public void Dispose()
            {
                rehearsals?.Dispose();
                agents.Dispose();
                world.Dispose();
            }
        }

        internal static void WalksByPlan(Files files)
        {
            const int goals = 8;
            (int arrived, int jumps) = Visit(files, goals, false);
            Expect.That(arrived * 4 >= goals * 3, $"{arrived} of {goals} arrived");
            (int rehearsed, int fewer) = Visit(files, goals, true);
            Expect.That(rehearsed == goals, $"{rehearsed} of {goals} arrived with rehearsals");
            Expect.That(fewer * 2 < jumps, $"{fewer} jumps with rehearsals, {jumps} without");
        }

        /// <summary>How many of some goals NPCs reached, and how often they jumped.</summary>
        private static (int, int) Visit(Files files, int goals, bool rehearses)
        {
            int arrived = 0;
            int jumps = 0;
            using (Map map = Map.Load(files.Level))
            using (Graph graph = Graph.Load(files.Graph))
            {
                Vec3[] places = graph.Vertices();
                for (int idx = 0; idx < goals; idx++)
                {
                    Vec3 goal = places[(idx * 7 + places.Length / 2) % places.Length];
                    using (Walker walker = new Walker(map, places[idx * 7], (ulong)idx, rehearses))
                    using (Attempt attempt = walker.Begin(graph, goal))
                    {
                        int decisions = walker.Walk(attempt);
                        bool isThere = attempt.State == AttemptState.Reached;
                        bool isGrounded = (walker.State.Flags & StateFlags.Grounded) != 0;
                        bool stands = isGrounded && (walker.Feet - goal).Length <= Agents.ReachedWithin;
                        Expect.That(stands || !isThere, "an NPC that has arrived stands at its goal");
                        Console.WriteLine($"        goal {idx}: {attempt.State} after {decisions * Agents.DecisionSeconds:0.0} s");
                        arrived += isThere ? 1 : 0;
                        jumps += walker.Jumps;
                    }
                }
            }
            return (arrived, jumps);
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

        internal static void ArrivesStanding(string square)
        {
            using (Map map = Map.Load(square))
            using (Walker walker = new Walker(map, map.Origin, 3))
            {
                Vec3 goal = map.Origin + new Vec3(5, 0, 0);
                CharacterState standing = walker.State;
                standing.Flags = StateFlags.Grounded;
                standing.Feet = goal + new Vec3(0.8f, 0, 0);
                CharacterState flying = standing;
                flying.Flags = StateFlags.None;
                CharacterState above = standing;
                above.Feet = goal + new Vec3(0, 0.9f, 0);
                int castCount = 0;
                SightHit wall = new SightHit { Distance = 0.5f, Surface = Surface.Ground };
                SightHit hit = wall;
                CastRays cast = (rays, hits) =>
                {
                    castCount++;
                    Expect.Equal(rays.Length, 2, "the number of rays to a goal");
                    hits[0] = default(SightHit);
                    hits[1] = hit;
                };
                using (Attempt attempt = walker.Begin(goal, cast))
                {
                    foreach (CharacterState state in new[] { flying, above })
                    {
                        attempt.Note(state);
                        Expect.Equal(attempt.State, AttemptState.GoesOn, "an attempt in the air, or on another floor");
                    }
                    Expect.Equal(castCount, 0, "the number of casts before the NPC stands near its goal");
                    attempt.Note(standing);
                    Expect.Equal(attempt.State, AttemptState.GoesOn, "an attempt behind a wall");
                    hit = default(SightHit);
                    attempt.Radius = 0.5f;
                    attempt.Note(standing);
                    Expect.Equal(attempt.State, AttemptState.GoesOn, "an attempt outside the radius");
                    attempt.Radius = 0.85f;
                    attempt.Note(standing);
                    Expect.Equal(attempt.State, AttemptState.Reached, "an attempt of an NPC that stands at its goal");
                    Expect.Equal(castCount, 2, "the number of casts");
                }
                using (Attempt attempt = walker.Begin(goal, null))
                {
                    attempt.Note(standing);
                    Expect.Equal(attempt.State, AttemptState.Reached, "an attempt without rays");
                }
                using (Attempt attempt = walker.Begin(goal, cast))
                {
                    attempt.Radius = -1;
                    Expect.Fails(Status.InvalidArgument, "radius", () => attempt.Note(standing));
                }
            }
        }

        internal static void ChasesStraight(string square)
        {
            using (Map map = Map.Load(square))
            using (Walker walker = new Walker(map, map.Origin, 3))
            using (Attempt attempt = walker.Begin(null, map.Origin + new Vec3(6, 0, -9)))
            {
                // 3 m/s, for 5 s.
                walker.Chase(attempt, decision => map.Origin + new Vec3(6 - Math.Min(decision, 30) * 0.5f, 0, -9));
                Expect.Equal(attempt.State, AttemptState.Reached, "the end of an attempt at a goal that moves");
                Expect.That(attempt.IsNearGoal(attempt.Goal, walker.Feet) == false, "an attempt that has ended has no goal to be near to");
            }
        }

        internal static void ChasesByPlan(Files files)
        {
            using (Map map = Map.Load(files.Level))
            using (Graph graph = Graph.Load(files.Graph))
            using (Follower follower = new Follower(graph.Vertices()[50]))
            {
                Vec3 start = graph.Vertices()[0];
                Vec3 goal = graph.Vertices()[50];
                Vec3 far = graph.Vertices()[20];
                Expect.That((far - goal).Length > 0.25f * (start - far).Length + 4, "one goal is far from the other");
                Expect.Equal(follower.MoveGoal(goal, start, false).Kind, StepKind.Plan, "the step without a plan");
                follower.PlanFrom(graph, start);
                Expect.Equal(follower.MoveGoal(goal + new Vec3(0.2f, 0, 0), start, false).Kind, StepKind.Keep, "the step after a small move");
                Expect.Equal(follower.MoveGoal(far, start, false).Kind, StepKind.Plan, "the step after a large move");
                FollowStep step = follower.PlanFrom(graph, start);
                Expect.Equal(step.Plans, 2u, "the number of plans");
                Expect.Equal(follower.Legs().Last().Waypoint, far, "the end of the second plan");
                Expect.Fails(Status.InvalidArgument, "goal", () => follower.MoveGoal(new Vec3(float.NaN, 0, 0), start, false));

                using (Walker walker = new Walker(map, start, 1))
                using (Attempt attempt = walker.Begin(graph, goal))
                {
                    attempt.Advance(walker.State);
                    Expect.That(attempt.IsNearGoal(goal + new Vec3(3, 0, 0), start), "3 m are near");
                    Expect.That(!attempt.IsNearGoal(far, start), "the other goal is not near");
                    attempt.MoveGoal(far, start);
                    AttemptState state = attempt.Advance(walker.State);
                    Expect.Equal(state, AttemptState.GoesOn, "the attempt after its goal has moved far");
                    Expect.Equal(attempt.Legs.Last().Waypoint, far, "the end of the plan of an attempt");
                    // The target walks up and down at 1.2 m/s.
                    int decisions = walker.Chase(attempt, decision => far + new Vec3(Math.Abs(decision % 20 - 10) * 0.2f, 0, 0));
                    Console.WriteLine($"        a target that moves: {attempt.State} after {decisions * Agents.DecisionSeconds:0.0} s");
                    Expect.Equal(attempt.State, AttemptState.Reached, "the end of a chase");
                }
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
                    attempt.Advance(walker.State);
                    Expect.That(attempt.Legs.Length > 0, "a plan has legs");
                    attempt.NoteDeath();
                    Expect.Equal(attempt.Advance(walker.State), AttemptState.GaveUp, "an attempt after a death");
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
