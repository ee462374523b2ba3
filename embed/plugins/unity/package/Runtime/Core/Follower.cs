using System;

namespace Surefoot
{
    /// <summary>
    /// An attempt at a goal by plan: waypoint by waypoint, another plan where there is no progress for 50 decisions, without the legs that
    /// failed. It neither senses nor moves anything; <see cref="Attempt"/> joins it with an agent.
    /// </summary>
    public sealed unsafe class Follower : IDisposable
    {
        private readonly FollowerHandle handle;

        /// <summary>Begins an attempt at a goal, without a plan.</summary>
        public Follower(Vec3 goal)
        {
            Library.RequireLoaded();
            NativeError error;
            Native.Check(NativeMethods.sf_follower_create(goal, out handle, &error), &error);
        }

        /// <summary>Makes this the same attempt as another follower, for rollbacks.</summary>
        public void CopyFrom(Follower other)
        {
            Native.CheckGiven(nameof(other), other);
            NativeError error;
            Native.Check(NativeMethods.sf_follower_copy(other.handle, handle, &error), &error);
        }

        /// <summary>
        /// Tells, once for every decision, where the feet are and whether they came within <see cref="Agents.ReachedWithin"/> of the waypoint
        /// meanwhile.
        /// </summary>
        public FollowStep Advance(Vec3 feet, bool reached)
        {
            NativeError error;
            FollowStep step = new FollowStep { StructSize = (uint)sizeof(FollowStep) };
            Native.Check(NativeMethods.sf_follower_advance(handle, feet, reached ? 1 : 0, &step, &error), &error);
            return step;
        }

        /// <summary>
        /// Moves the goal of the attempt, whenever the target has moved, such as before each decision. The last leg leads to the new goal, and
        /// once the goal has drifted far, the step is <see cref="StepKind.Plan"/>; until then, and until the next plan, the present one stays.
        /// </summary>
        public FollowStep MoveGoal(Vec3 goal, Vec3 feet, bool reached)
        {
            NativeError error;
            FollowStep step = new FollowStep { StructSize = (uint)sizeof(FollowStep) };
            Native.Check(NativeMethods.sf_follower_move_goal(handle, goal, feet, reached ? 1 : 0, &step, &error), &error);
            return step;
        }

        /// <summary>Plans from where the feet are, without the legs that have failed, and follows that plan.</summary>
        public FollowStep PlanFrom(Graph graph, Vec3 feet, float caution = 1, Abilities without = Abilities.None)
        {
            Native.CheckGiven(nameof(graph), graph);
            NativeError error;
            FollowStep step = new FollowStep { StructSize = (uint)sizeof(FollowStep) };
            Native.Check(NativeMethods.sf_follower_plan(handle, graph.Handle, feet, caution, (uint)without, &step, &error), &error);
            return step;
        }

        /// <summary>
        /// Prepares the next decision of an agent, whose places are on the map: smooths the plan and rehearses its next two legs. Do what the step
        /// says and call it again, until the step is <see cref="StepKind.Keep"/>.
        /// </summary>
        public FollowStep Prepare(Rehearsals rehearsals, Agents agents, uint agent, CharacterState state)
        {
            Native.CheckGiven(nameof(rehearsals), rehearsals);
            Native.CheckGiven(nameof(agents), agents);
            NativeError error;
            state.StructSize = (uint)sizeof(CharacterState);
            FollowStep step = new FollowStep { StructSize = (uint)sizeof(FollowStep) };
            Native.Check(
                NativeMethods.sf_follower_prepare(handle, rehearsals.Handle, agents.Handle, agent, &state, default(Vec3), &step, &error), &error);
            return step;
        }

        /// <summary>Changes how the NPC goes, at any time; a <see cref="StepKind.Plan"/> follows if it would take another way.</summary>
        public FollowStep SetGait(Gait gait)
        {
            NativeError error;
            gait.StructSize = (uint)sizeof(Gait);
            FollowStep step = new FollowStep { StructSize = (uint)sizeof(FollowStep) };
            Native.Check(NativeMethods.sf_follower_set_gait(handle, &gait, &step, &error), &error);
            return step;
        }

        /// <summary>Reports that the NPC died, which ends the attempt.</summary>
        public void NoteDeath()
        {
            NativeError error;
            Native.Check(NativeMethods.sf_follower_note_death(handle, &error), &error);
        }

        /// <summary>The legs of the plan that is followed.</summary>
        public Leg[] Legs() =>
            Native.All<Leg>((items, capacity, count, error) => NativeMethods.sf_follower_legs(handle, (Leg*)items, capacity, count, error));

        /// <summary>Takes how the NPC got along edges since the last call, for <see cref="Graph.NoteTraversals"/>.</summary>
        public Traversal[] TakeTraversals() =>
            Native.All<Traversal>((items, capacity, count, error) =>
                NativeMethods.sf_follower_take_traversals(handle, (Traversal*)items, capacity, count, error));

        public void Dispose() => handle.Dispose();
    }
}
