using System;

namespace Surefoot
{
    /// <summary>How an <see cref="Attempt"/> stands.</summary>
    public enum AttemptState
    {
        GoesOn,
        /// <summary>The NPC came within <see cref="Agents.ReachedWithin"/> of its goal.</summary>
        Reached,
        /// <summary>The attempt has failed: no plan led on, or the NPC died or came no closer.</summary>
        GaveUp,
        /// <summary>No path leads to the goal, and the NPC is as near as it can get.</summary>
        Unreachable,
    }

    /// <summary>
    /// One try of an agent to reach a goal: along plans of a graph, or straight on without one. Call <see cref="Note"/> every tick, and
    /// <see cref="Advance"/> before each decision of the agent.
    /// </summary>
    public sealed class Attempt : IDisposable
    {
        private readonly Agents agents;
        private readonly uint agent;
        private readonly Graph graph;
        private readonly Follower follower;
        private readonly float caution;
        private readonly Abilities without;
        private bool isAtWaypoint;
        private bool hasPlan;

        /// <summary>
        /// Begins an attempt of an agent whose feet are at a place. `graph` is null for goals in sight, or where no graph was proved; then
        /// `caution` and `without`, which are those of a <see cref="PathQuery"/>, are ignored.
        /// </summary>
        public Attempt(Agents agents, uint agent, Graph graph, Vec3 feet, Vec3 goal, float caution = 1, Abilities without = Abilities.None)
        {
            Native.CheckGiven(nameof(agents), agents);
            this.agents = agents;
            this.agent = agent;
            this.graph = graph;
            this.caution = caution;
            this.without = without;
            Goal = goal;
            HeadFor(feet, goal);
            follower = graph == null ? null : new Follower(goal);
        }

        public Vec3 Goal { get; }

        /// <summary>Where the NPC heads for now: the end of a leg, or the goal.</summary>
        public Vec3 Waypoint { get; private set; }

        public AttemptState State { get; private set; }

        /// <summary>The legs of the plan that is followed; none without a plan.</summary>
        public Leg[] Legs => follower != null && State == AttemptState.GoesOn && hasPlan ? follower.Legs() : new Leg[0];

        /// <summary>Index of the current leg in <see cref="Legs"/>.</summary>
        public int LegIndex { get; private set; }

        /// <summary>Tells, every tick, where the feet are, so that no waypoint is missed that is passed between decisions.</summary>
        public void Note(Vec3 feet)
        {
            if (State != AttemptState.GoesOn)
            {
                return;
            }
            isAtWaypoint |= agents.Note(agent, feet);
            if ((feet - Goal).Length <= Agents.ReachedWithin)
            {
                // The follower notes the end of its last traversal; nothing follows from its answer any more.
                follower?.Advance(feet, isAtWaypoint);
                End(AttemptState.Reached);
            }
        }

        /// <summary>Plans, heads for the next waypoint, or ends the attempt: to be called before each decision of the agent.</summary>
        public AttemptState Advance(Vec3 feet)
        {
            Note(feet);
            if (State != AttemptState.GoesOn)
            {
                return State;
            }
            if (follower == null)
            {
                if (agents.ProgressOf(agent).StalledDecisions >= Agents.HopelessAfter)
                {
                    End(AttemptState.GaveUp);
                }
                return State;
            }
            Follow(feet);
            return State;
        }

        /// <summary>Reports that the NPC died.</summary>
        public void NoteDeath()
        {
            if (State == AttemptState.GoesOn)
            {
                follower?.NoteDeath();
                End(AttemptState.GaveUp);
            }
        }

        /// <summary>Ends the attempt where it stands; what the NPC met on edges is kept.</summary>
        public void Dispose()
        {
            if (State == AttemptState.GoesOn)
            {
                End(AttemptState.GaveUp);
            }
            follower?.Dispose();
        }

        private void Follow(Vec3 feet)
        {
            FollowStep step = follower.Advance(feet, isAtWaypoint);
            if (step.Kind == StepKind.Plan)
            {
                step = follower.PlanFrom(graph, feet, caution, without);
            }
            hasPlan = step.LegCount > 0;
            LegIndex = (int)step.Leg;
            switch (step.Kind)
            {
                case StepKind.Head:
                    HeadFor(feet, step.Waypoint);
                    break;
                case StepKind.GiveUp:
                    End(AttemptState.GaveUp);
                    break;
                case StepKind.Unreachable:
                    End(AttemptState.Unreachable);
                    break;
            }
        }

        private void HeadFor(Vec3 feet, Vec3 waypoint)
        {
            agents.SetGoal(agent, feet, waypoint);
            Waypoint = waypoint;
            isAtWaypoint = false;
        }

        private void End(AttemptState state)
        {
            State = state;
            // At the end of a scene, the graph may be gone before its agents.
            if (follower != null && !graph.Handle.IsClosed)
            {
                graph.NoteTraversals(follower.TakeTraversals());
            }
        }
    }
}
