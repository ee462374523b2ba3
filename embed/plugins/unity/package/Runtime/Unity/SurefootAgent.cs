using System;
using UnityEngine;

namespace Surefoot.Unity
{
    /// <summary>A character that the policy moves to goals, along plans where its brain has a graph.</summary>
    [RequireComponent(typeof(CharacterController))]
    [AddComponentMenu("Surefoot/Surefoot Agent")]
    public sealed class SurefootAgent : MonoBehaviour
    {
        [SerializeField, Tooltip("Who decides; empty for the brain of the scene")] private SurefootBrain brain;
        [SerializeField, Tooltip("What to go to and follow while it moves; empty for goals from code")] private Transform goal;
        [SerializeField, Tooltip("How near to its goal the character must stand, m"), Range(0.1f, 10)]
        private float radius = Agents.ReachedWithin;
        [SerializeField, Tooltip("How much plans do to avoid deaths: 0 bold to 1 careful"), Range(0, 1)] private float caution = 1;
        [SerializeField, Tooltip("Decides the noise of the agent, together with its number")] private int seed;

        private CharacterController controller;
        private CharacterMotion motion;
        private Attempt attempt;
        private bool isMember;
        private bool isReported;

        /// <summary>An attempt ended: the goal was reached or is unreachable, or the agent gave up.</summary>
        public event Action<SurefootAgent, AttemptState> Ended;

        /// <summary>How the attempt stands; null without one.</summary>
        public AttemptState? State => attempt?.State;

        /// <summary>m/s; to be set by whatever throws the character, such as a jump pad.</summary>
        public Vector3 Velocity
        {
            get => UnityFrame.Mirror(motion.Velocity).ToVector3();
            set => motion.Velocity = UnityFrame.Mirror(value.ToVec3());
        }

        /// <summary>The lowest point of the character.</summary>
        public Vector3 Feet => transform.position + controller.center - Vector3.up * (controller.height / 2);

        internal uint Number { get; private set; }

        private CharacterState CharacterState => new CharacterState
        {
            Flags = motion.Flags,
            Feet = FeetOnMap,
            Velocity = motion.Velocity,
            Yaw = motion.Yaw,
        };

        private Vec3 FeetOnMap => brain.Frame.ToMap(Feet.ToVec3());

        /// <summary>
        /// Goes to a goal on the ground. Near the present goal, the attempt goes on with the new one, so a target that moves may be passed in every
        /// frame. Elsewhere another attempt begins, and the present one ends where it stands.
        /// </summary>
        public void GoTo(Vector3 place) => GoTo(place, radius);

        /// <summary>Goes to a goal where the character must stand within a radius, m.</summary>
        public void GoTo(Vector3 place, float within)
        {
            if (!isMember)
            {
                throw new SurefootException(Status.BadState, $"{name} is not enabled: call GoTo after its OnEnable");
            }
            Vec3 wanted = brain.Frame.ToMap(place.ToVec3());
            if (attempt != null && attempt.IsNearGoal(wanted, FeetOnMap))
            {
                attempt.MoveGoal(wanted, FeetOnMap);
                attempt.Radius = within;
                return;
            }
            attempt?.Dispose();
            isReported = false;
            attempt = new Attempt(brain.Agents, Number, brain.Graph, FeetOnMap, wanted, caution, cast: brain.CastRays)
            {
                Radius = within,
                Rehearsals = brain.Rehearsals,
            };
        }

        /// <summary>Ends the attempt, and lets the character come to a halt.</summary>
        public void Stop()
        {
            attempt?.Dispose();
            attempt = null;
            motion?.Decide(default(AgentAction));
        }

        /// <summary>Call this when the character has died; place it elsewhere, and begin another attempt.</summary>
        public void NoteDeath()
        {
            attempt?.NoteDeath();
            ReportEnd();
        }

        /// <summary>Plans and describes the character for a decision; false if it needs none.</summary>
        internal bool BeginDecision(out CharacterState state)
        {
            HeadForGoal();
            state = CharacterState;
            return attempt != null && attempt.Advance(state) == AttemptState.GoesOn;
        }

        internal void Act(in AgentAction action) => motion.Decide(action);

        /// <summary>Once an attempt has ended, halts and raises the event.</summary>
        internal void ReportEnd()
        {
            if (attempt != null && attempt.State != AttemptState.GoesOn && !isReported)
            {
                isReported = true;
                motion.Decide(default(AgentAction));
                Ended?.Invoke(this, attempt.State);
            }
        }

        private void HeadForGoal()
        {
            if (goal == null)
            {
                return;
            }
            Vec3 wanted = brain.Frame.ToMap(goal.position.ToVec3());
            bool goesOn = attempt != null && attempt.State == AttemptState.GoesOn;
            if (attempt == null || goesOn || (wanted - attempt.Goal).Length > Agents.ReachedWithin)
            {
                GoTo(goal.position);
            }
        }

        private void OnEnable()
        {
            controller = GetComponent<CharacterController>();
            brain = brain != null ? brain : SurefootBrain.OfScene();
            Number = brain.Join(this);
            isMember = true;
            brain.Agents.Begin(Number, (ulong)(uint)seed + Number);
            brain.BodySettings.Shape(controller);
            motion = new CharacterMotion(brain.BodySettings.ToBody()) { Yaw = UnityFrame.Yaw(transform.eulerAngles.y) };
        }

        private void OnDisable()
        {
            if (isMember)
            {
                attempt?.Dispose();
                attempt = null;
                brain.Leave(this, Number);
                isMember = false;
            }
        }

        private void FixedUpdate()
        {
            if (!isMember)
            {
                return;
            }
            float seconds = Time.fixedDeltaTime;
            motion.Advance(seconds);
            transform.rotation = Quaternion.Euler(0, UnityFrame.Degrees(motion.Yaw), 0);
            Vector3 before = transform.position;
            Move(seconds);
            Vector3 moved = (transform.position - before) / seconds;
            motion.Moved(UnityFrame.Mirror(moved.ToVec3()), controller.isGrounded, seconds);
            attempt?.Note(CharacterState);
        }

        private void Move(float seconds)
        {
            bool stays = motion.IsGrounded;
            float snap = motion.SnapDistance(seconds);
            controller.Move(Velocity * seconds);
            if (stays && !controller.isGrounded)
            {
                // Down a slope or step, a character that stood stays on the ground; over an edge it takes off.
                controller.Move(Vector3.down * snap);
                if (!controller.isGrounded)
                {
                    controller.Move(Vector3.up * snap);
                }
            }
        }
    }
}
