using System;

namespace Surefoot
{
    /// <summary>
    /// Velocity and yaw of a character that follows actions, by the rules of the simulation in which policies were trained
    /// (`core/world/src/character/tick.rs`): only what moves like that meets what the policy expects. The game moves the character, finds what it
    /// collides with, and says so with <see cref="Moved"/>.
    /// </summary>
    public sealed class CharacterMotion
    {
        /// <summary>Terminal speed of a fall, m/s.</summary>
        private const float MaxFallSpeed = 45;
        private const float SecondsPerTick = 1f / World.TicksPerSecond;

        private readonly Body body;
        private AgentAction action;
        private bool isJumpPending;
        private uint airJumpsLeft;
        private float secondsInAir;
        /// <summary>A jump is possible from the ground once only, however long that still counts as underfoot.</summary>
        private bool hasLeftGround;

        public CharacterMotion(in Body body)
        {
            this.body = body;
            airJumpsLeft = body.ExtraJumps;
        }

        /// <summary>m/s; to be set where something else pushes or throws the character.</summary>
        public Vec3 Velocity { get; set; }

        /// <summary>rad.</summary>
        public float Yaw { get; set; }

        public bool IsGrounded { get; private set; }

        public StateFlags Flags =>
            IsGrounded ? StateFlags.Grounded | StateFlags.CanJump : CanJump ? StateFlags.CanJump : StateFlags.None;

        private bool CountsAsGrounded => IsGrounded || (!hasLeftGround && secondsInAir <= body.CoyoteTicks * SecondsPerTick);

        private bool CanJump => CountsAsGrounded || airJumpsLeft > 0;

        /// <summary>How far below the feet, m, ground still holds a character that stood on it and moves as it does: down slopes and steps.</summary>
        public float SnapDistance(float seconds) =>
            body.StepHeight + HorizontalSpeed(Velocity) * seconds * (float)Math.Tan(body.MaxSlope);

        /// <summary>Holds an action until the next one; it asks for one jump at most.</summary>
        public void Decide(in AgentAction decided)
        {
            action = decided;
            isJumpPending = decided.Jump > 0;
        }

        /// <summary>Turns and accelerates for some seconds, usually a fixed step. The game then moves the character by the velocity.</summary>
        public void Advance(float seconds)
        {
            Yaw = Wrapped(Yaw + action.Turn * body.TurnSpeed * seconds);
            Accelerate(seconds);
            Jump();
        }

        /// <summary>Tells how fast the character really moved, m/s, and whether it now stands on walkable ground.</summary>
        public void Moved(Vec3 velocity, bool isGrounded, float seconds)
        {
            if (isGrounded)
            {
                // Climbing a step lifts the character in an instant, which is no speed that would carry it on.
                float steepest = HorizontalSpeed(velocity) * (float)Math.Tan(body.MaxSlope);
                velocity.Y = Math.Max(-steepest, Math.Min(velocity.Y, steepest));
                airJumpsLeft = body.ExtraJumps;
                hasLeftGround = false;
            }
            secondsInAir = isGrounded ? 0 : secondsInAir + seconds;
            Velocity = velocity;
            IsGrounded = isGrounded;
        }

        private void Accelerate(float seconds)
        {
            Vec3 wish = Wish();
            Vec3 change = new Vec3(wish.X - Velocity.X, 0, wish.Z - Velocity.Z);
            float most = (IsGrounded ? body.GroundAcceleration : body.AirAcceleration) * seconds;
            float length = change.Length;
            if (length > most)
            {
                change *= most / length;
            }
            Vec3 velocity = Velocity + change;
            velocity.Y = Math.Max(velocity.Y - body.Gravity * seconds, -MaxFallSpeed);
            Velocity = velocity;
        }

        /// <summary>The horizontal velocity that the action asks for, m/s.</summary>
        private Vec3 Wish()
        {
            float sin = (float)Math.Sin(Yaw);
            float cos = (float)Math.Cos(Yaw);
            float forward = Math.Max(action.Forward, -body.SideSpeedShare);
            float right = action.Strafe * body.SideSpeedShare;
            Vec3 wish = new Vec3(sin * forward - cos * right, 0, cos * forward + sin * right);
            return wish * (body.ForwardSpeed / Math.Max(wish.Length, 1));
        }

        private void Jump()
        {
            if (!isJumpPending || !CanJump)
            {
                return;
            }
            if (!CountsAsGrounded)
            {
                airJumpsLeft--;
            }
            Velocity = new Vec3(Velocity.X, body.JumpSpeed, Velocity.Z);
            IsGrounded = false;
            hasLeftGround = true;
            isJumpPending = false;
        }

        private static float HorizontalSpeed(Vec3 velocity) => new Vec3(velocity.X, 0, velocity.Z).Length;

        private static float Wrapped(float yaw)
        {
            const float turn = (float)(2 * Math.PI);
            return yaw > Math.PI ? yaw - turn : yaw <= -Math.PI ? yaw + turn : yaw;
        }
    }
}
