using System;

namespace Surefoot
{
    /// <summary>How an <see cref="Attempt"/> stands.</summary>
    public enum AttemptState
    {
        GoesOn,
        /// <summary>The NPC stood within the radius of its goal, with nothing solid between.</summary>
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
        /// <summary>How far a place is from the goal at most to be near it: in metres, and as a share of the NPC's distance from the goal.</summary>
        private const float NearM = 4;
        private const float NearShare = 0.25f;

        private readonly Agents agents;
        private readonly uint agent;
        private readonly Graph graph;
        private readonly Follower follower;
        private readonly float caution;
        private readonly Abilities without;
        private readonly CastRays cast;
        private bool isAtWaypoint;
        private bool hasPlan;
        private bool stands;
        private bool needsPlan;
        private Vec3 stoodAt;
        private uint standing;

        /// <summary>
        /// Begins an attempt of an agent whose feet are at a place. `graph` is null for goals in sight, or where no
        /// graph was proved; then `caution` and `without`, which are those of a <see cref="PathQuery"/>, are ignored.
        /// `cast` looks for walls and floors before the goal; null: there are none.
        /// </summary>
        public Attempt(
            Agents agents,
            uint agent,
            Graph graph,
            Vec3 feet,
            Vec3 goal,
            float caution = 1,
            Abilities without = Abilities.None,
            CastRays cast = null)
        {
            Native.CheckGiven(nameof(agents), agents);
            this.agents = agents;
            this.agent = agent;
            this.graph = graph;
            this.caution = caution;
            this.without = without;
            this.cast = cast;
            Goal = goal;
            stoodAt = feet;
            HeadFor(feet, goal);
            follower = graph == null ? null : new Follower(goal);
        }

        public Vec3 Goal { get; private set; }

        /// <summary>Distance from the goal within which the NPC must stand, 0 to 30 m.</summary>
        public float Radius { get; set; } = Agents.ReachedWithin;

        /// <summary>Rehearsals for the agent's policy and body; null: the NPC follows its plans without.</summary>
        public Rehearsals Rehearsals { get; set; }

        /// <summary>Where the NPC heads for now: the end of a leg, or the goal.</summary>
        public Vec3 Waypoint { get; private set; }

        public AttemptState State { get; private set; }

        /// <summary>The legs of the plan that is followed; none without a plan.</summary>
        public Leg[] Legs => follower != null && State == AttemptState.GoesOn && hasPlan ? follower.Legs() : new Leg[0];

        /// <summary>Index of the current leg in <see cref="Legs"/>.</summary>
        public int LegIndex { get; private set; }

        /// <summary>
        /// Whether a place is so near the goal of an attempt that goes on that <see cref="MoveGoal"/> serves better than another attempt: within
        /// 4 m, or within a quarter of the distance between the NPC and its goal.
        /// </summary>
        public bool IsNearGoal(Vec3 place, Vec3 feet) =>
            State == AttemptState.GoesOn && (place - Goal).Length <= Math.Max(NearM, NearShare * (feet - Goal).Length);

        /// <summary>
        /// Moves the goal of an NPC whose feet are at a place, as often as its target moves: the attempt goes on, and the NPC takes another plan
        /// once the goal has drifted far. An attempt that has ended stays ended.
        /// </summary>
        public void MoveGoal(Vec3 goal, Vec3 feet)
        {
            if (State != AttemptState.GoesOn)
            {
                return;
            }
            if (follower == null)
            {
                if (!goal.Equals(Waypoint))
                {
                    HeadFor(feet, goal);
                }
            }
            else
            {
                FollowStep step = follower.MoveGoal(goal, feet, isAtWaypoint);
                needsPlan = step.Kind == StepKind.Plan;
                if (step.Kind == StepKind.Head)
                {
                    HeadFor(feet, step.Waypoint);
                }
            }
            Goal = goal;
        }

        /// <summary>Tells, every tick, where the NPC is, so that it passes nothing unnoticed between decisions.</summary>
        public void Note(in CharacterState state)
        {
            if (State != AttemptState.GoesOn)
            {
                return;
            }
            bool isPassed = agents.Note(agent, state.Feet);
            // Waypoints are passed on the run or in flight, but at some the NPC stands. If that is the goal itself, the
            // follower counts the time until the NPC has arrived there.
            isAtWaypoint |= stands
                ? !Waypoint.Equals(Goal) && HasArrived(state, Waypoint, Agents.ReachedWithin)
                : isPassed;
            if (HasArrived(state, Goal, Radius))
            {
                // The follower notes the end of its last traversal; nothing follows from its answer any more.
                follower?.Advance(state.Feet, isAtWaypoint);
                End(AttemptState.Reached);
            }
        }

        /// <summary>Plans, heads for the next waypoint, or ends the attempt: to be called before each decision of the agent.</summary>
        public AttemptState Advance(in CharacterState state)
        {
            Note(state);
            if (State != AttemptState.GoesOn)
            {
                return State;
            }
            if (follower == null)
            {
                AdvanceStraight(state.Feet);
                return State;
            }
            Follow(state);
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

        private bool HasArrived(in CharacterState state, Vec3 place, float radius) =>
            agents.HasArrived(state, place, radius, cast);

        private void AdvanceStraight(Vec3 feet)
        {
            // Progress starts again whenever the goal moves, so an NPC that stands still gives up as well.
            standing++;
            if ((feet - stoodAt).Length > Agents.ReachedWithin)
            {
                stoodAt = feet;
                standing = 0;
            }
            if (Math.Max(standing, agents.ProgressOf(agent).StalledDecisions) >= Agents.HopelessAfter)
            {
                End(AttemptState.GaveUp);
            }
        }

        private void Follow(in CharacterState state)
        {
            FollowStep step = follower.Advance(state.Feet, isAtWaypoint);
            bool goesOn = step.Kind == StepKind.Keep || step.Kind == StepKind.Head;
            if (needsPlan && goesOn)
            {
                step.Kind = StepKind.Plan;
            }
            needsPlan = false;
            Take(ref step, state.Feet);
            while (Rehearsals != null && State == AttemptState.GoesOn)
            {
                step = follower.Prepare(Rehearsals, agents, agent, state);
                if (step.Kind == StepKind.Keep)
                {
                    break;
                }
                Take(ref step, state.Feet);
            }
            hasPlan = step.LegCount > 0;
            LegIndex = (int)step.Leg;
            stands = step.Stands != 0;
        }

        /// <summary>Does what a step says, which may be to take another plan, with a step of its own.</summary>
        private void Take(ref FollowStep step, Vec3 feet)
        {
            if (step.Kind == StepKind.Plan)
            {
                step = follower.PlanFrom(graph, feet, caution, without);
            }
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

        /// <summary>Changes how the NPC goes where it can walk; it needs <see cref="Rehearsals"/> for more than to avoid jumps.</summary>
        public void SetGait(Gait gait)
        {
            if (follower != null && State == AttemptState.GoesOn && follower.SetGait(gait).Kind == StepKind.Plan)
            {
                needsPlan = true;
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
