// What characters are, sense and do. All structs are laid out as those of surefoot.h, which is the reference for ranges.
//
// Everything here is in Surefoot's frame: metres, seconds, radians, right-handed, y up, yaw 0 faces +z and grows counter-clockwise seen from
// above. UnityFrame converts.
using System;
using System.Runtime.InteropServices;

namespace Surefoot
{
    /// <summary>A place, m, a velocity, m/s, or a direction; <c>sf_vec3</c>.</summary>
    [StructLayout(LayoutKind.Sequential)]
    public struct Vec3 : IEquatable<Vec3>
    {
        public float X;
        public float Y;
        public float Z;

        public Vec3(float x, float y, float z)
        {
            X = x;
            Y = y;
            Z = z;
        }

        public float Length => (float)Math.Sqrt(X * X + Y * Y + Z * Z);

        public static Vec3 operator +(Vec3 left, Vec3 right) => new Vec3(left.X + right.X, left.Y + right.Y, left.Z + right.Z);

        public static Vec3 operator -(Vec3 left, Vec3 right) => new Vec3(left.X - right.X, left.Y - right.Y, left.Z - right.Z);

        public static Vec3 operator *(Vec3 vector, float factor) => new Vec3(vector.X * factor, vector.Y * factor, vector.Z * factor);

        public bool Equals(Vec3 other) => X == other.X && Y == other.Y && Z == other.Z;

        public override bool Equals(object other) => other is Vec3 && Equals((Vec3)other);

        public override int GetHashCode() => (X.GetHashCode() * 397 ^ Y.GetHashCode()) * 397 ^ Z.GetHashCode();

        public override string ToString() => $"({X}, {Y}, {Z})";
    }

    /// <summary>A place of a level in the coordinates of its file; <c>sf_place</c>.</summary>
    [StructLayout(LayoutKind.Sequential)]
    public struct LevelPlace
    {
        public double X;
        public double Y;
        public double Z;
    }

    /// <summary>How the coordinates of a level's file relate to the map's; <c>sf_frame</c>.</summary>
    [StructLayout(LayoutKind.Sequential)]
    public struct LevelFrame
    {
        /// <summary>Position of the level's origin on the map, m.</summary>
        public LevelPlace Origin;
        /// <summary>Metres per unit of the level.</summary>
        public double Scale;
        /// <summary>1 if z is up in the level, 0 if y is.</summary>
        public int ZUp;
    }

    /// <summary>A ray of <see cref="Agents.RayRange"/> m to be cast in the game's physics; <c>sf_ray</c>.</summary>
    [StructLayout(LayoutKind.Sequential)]
    public struct SightRay
    {
        public Vec3 Origin;
        /// <summary>Of length 1.</summary>
        public Vec3 Direction;
    }

    /// <summary>What a ray ended on; <c>sf_hit</c>. The default value is nothing within range.</summary>
    [StructLayout(LayoutKind.Sequential)]
    public struct SightHit
    {
        /// <summary>Distance to the surface, m; ignored for <see cref="Surefoot.Surface.None"/>.</summary>
        public float Distance;
        /// <summary>Distance to another character, m, 0 for none; only for policies that see others.</summary>
        public float BodyDistance;
        public Surface Surface;
    }

    /// <summary>The controls of a character for one decision, each -1 to 1; <c>sf_action</c>.</summary>
    [StructLayout(LayoutKind.Sequential)]
    public struct AgentAction
    {
        /// <summary>Moves forward (positive) or backward, as a share of the top speed.</summary>
        public float Forward;
        /// <summary>Moves to the right (positive) or to the left.</summary>
        public float Strafe;
        /// <summary>Turns to the left (positive: yaw grows) or to the right, as a share of the top turning speed.</summary>
        public float Turn;
        /// <summary>Jumps once if positive, from the ground or again in the air.</summary>
        public float Jump;
    }

    /// <summary>Another character in sight; <c>sf_other</c>.</summary>
    [StructLayout(LayoutKind.Sequential)]
    public struct OtherCharacter
    {
        public Vec3 Feet;
        public Vec3 Velocity;
    }

    /// <summary>A device of the level: agents sense the nearest; <c>sf_device</c>.</summary>
    [StructLayout(LayoutKind.Sequential)]
    public struct Device
    {
        /// <summary>A pad, zip line, teleporter or jetpack.</summary>
        public Surface Kind;
        /// <summary>1 for a teleporter that leads back as well, 0 otherwise.</summary>
        public int TwoWay;
        /// <summary>Centre of a pad or jetpack, or the entrance, on the ground, m.</summary>
        public Vec3 From;
        /// <summary>Where a zip line or teleporter leads, on the ground, m; ignored for others.</summary>
        public Vec3 To;
    }

    /// <summary>An upright box that the game has put into its level, such as a crate or a closed door; <c>sf_block</c>.</summary>
    [StructLayout(LayoutKind.Sequential)]
    public struct Block
    {
        /// <summary>Middle of its bottom on the map, m.</summary>
        public Vec3 Foot;
        /// <summary>Extent along x before it is turned, m (0.05 to 1000).</summary>
        public float Width;
        /// <summary>Extent along z before it is turned, m (0.05 to 1000).</summary>
        public float Depth;
        /// <summary>Extent upwards, m (0.05 to 1000).</summary>
        public float Height;
        /// <summary>Turn about the upright axis, rad, counter-clockwise seen from above.</summary>
        public float Yaw;
    }

    /// <summary>What makes a character move as it does; <c>sf_body</c>. Begin with <see cref="Default"/>.</summary>
    [StructLayout(LayoutKind.Sequential)]
    public struct Body
    {
        internal uint StructSize;
        /// <summary>m, 2 radii to 4.</summary>
        public float Height;
        /// <summary>m, 0.15 to 1.</summary>
        public float Radius;
        /// <summary>Top speed forward, m/s, 0.1 to 20.</summary>
        public float ForwardSpeed;
        /// <summary>Top speed backwards and sideways as a share of that, 0 to 1.</summary>
        public float SideSpeedShare;
        /// <summary>Top turning speed, rad/s, 0.1 to 20.</summary>
        public float TurnSpeed;
        /// <summary>Upward speed of a jump, m/s, 0 to 30.</summary>
        public float JumpSpeed;
        /// <summary>m/s2, 1 to 100.</summary>
        public float Gravity;
        /// <summary>Steepest walkable slope, rad, 0 to 1.4.</summary>
        public float MaxSlope;
        /// <summary>Highest step that is climbed without a jump, m, 0 to half of the height.</summary>
        public float StepHeight;
        /// <summary>Horizontal acceleration on the ground, m/s2, 1 to 1000.</summary>
        public float GroundAcceleration;
        /// <summary>Horizontal acceleration in the air, m/s2, 0 to 1000.</summary>
        public float AirAcceleration;
        /// <summary>m/s, 1 to 40; only worlds use this and the next two.</summary>
        public float ZipLineSpeed;
        /// <summary>Upward acceleration of a jetpack, m/s2, 0 to 200.</summary>
        public float JetpackAcceleration;
        /// <summary>Upward speed at which a jetpack stops pushing, m/s, 0 to 40.</summary>
        public float JetpackClimbSpeed;
        /// <summary>Jumps in the air before the character must land, 0 to 255.</summary>
        public uint ExtraJumps;
        /// <summary>Ticks of 1/60 s after leaving the ground during which a jump still counts as one from the ground, 0 to 254.</summary>
        public uint CoyoteTicks;
        /// <summary>Whether the character can use zip lines, 0 or 1.</summary>
        public int UsesZipLines;
        /// <summary>Whether the character can use jetpacks, 0 or 1.</summary>
        public int UsesJetpacks;
        /// <summary>Speed up ladders and other faces that can be climbed, m/s, 0 to 10; 0 if the character cannot climb.</summary>
        public float ClimbSpeed;
        /// <summary>Greatest height above its feet of a ledge to which the character pulls itself up, m; 0 if it cannot.</summary>
        public float MantleHeight;
        /// <summary>Speed in water that is too deep to wade, m/s, 0 to 10; 0 if the character cannot swim.</summary>
        public float SwimSpeed;
        /// <summary>Height of the character when it crouches, m; 0 if it cannot.</summary>
        public float CrouchHeight;
        /// <summary>Speed of a dash in the air, m/s, 0 to 40; 0 if the character makes none.</summary>
        public float DashSpeed;
        /// <summary>How long the character runs along a wall in the air, s: 0 (it cannot) to 10.</summary>
        public float WallRunSeconds;
        /// <summary>How long the character keeps its speed under what is lower than it, s: 0 to 10; needs a CrouchHeight.</summary>
        public float SlideSeconds;
        /// <summary>How long the character can be under water, s: 0 (it cannot dive) to 600; needs a SwimSpeed.</summary>
        public float DiveSeconds;

        /// <summary>The body that policies were trained with: 1.8 m tall, 11 m/s, a double jump.</summary>
        public static unsafe Body Default
        {
            get
            {
                Library.RequireLoaded();
                NativeError error;
                Body body;
                Native.Check(NativeMethods.sf_body_default(&body, &error), &error);
                return body;
            }
        }
    }

    /// <summary>Where a character is and how it moves; <c>sf_state</c>.</summary>
    [StructLayout(LayoutKind.Sequential)]
    public struct CharacterState
    {
        internal uint StructSize;
        public StateFlags Flags;
        public Vec3 Feet;
        public Vec3 Velocity;
        /// <summary>rad, any finite value.</summary>
        public float Yaw;
        /// <summary>Share of its breath that the character has used up under water, 0 to 1, in steps of 1/300.</summary>
        public float BreathUsed;
        /// <summary>Thrust that its jetpack has left, s; 0 without one.</summary>
        public float JetpackSeconds;
        /// <summary>Number of others in sight, at most 64; 0 unless the policy sees others.</summary>
        public uint OtherCount;
        /// <summary>
        /// That many <see cref="OtherCharacter"/> in memory that does not move, such as a NativeArray's, or zero.
        /// </summary>
        public IntPtr Others;
    }

    /// <summary>How a character moves, for its animator; <c>sf_locomotion</c>. Begin with the default value.</summary>
    [StructLayout(LayoutKind.Sequential)]
    public struct Locomotion
    {
        internal uint StructSize;
        /// <summary>What its legs do; in the air, what they did last.</summary>
        public Pace Pace;
        public MovePhase Phase;
        /// <summary>Ability of its leap or ride; walking in a fall and without a phase.</summary>
        public Ability Ability;
        /// <summary>Length of a stride, which is two steps, m; 0 unless it moves on the ground.</summary>
        public float Stride;
        /// <summary>Share of the stride done, 0 to 1: one foot is put down at 0, the other at 0.5.</summary>
        public float StridePhase;
        internal uint Ticks;
        internal int WasThrown;
        /// <summary>
        /// Height to add to the drawn character, m, so that its height changes smoothly over steps: up to the body's
        /// step height, and negative after a step up.
        /// </summary>
        public float StepOffset;
        internal float FeetHeight;
        internal float Rise;
        internal int WasGrounded;

        /// <summary>
        /// Follows the character by one tick of 1/60 s, in which it carried out <paramref name="action"/>, used
        /// <paramref name="used"/>, and came to <paramref name="state"/>.
        /// </summary>
        public unsafe void Advance(Body body, CharacterState state, AgentAction action, Ability used = Ability.Walk)
        {
            NativeError error;
            Locomotion after = this;
            after.StructSize = (uint)sizeof(Locomotion);
            body.StructSize = (uint)sizeof(Body);
            state.StructSize = (uint)sizeof(CharacterState);
            Native.Check(NativeMethods.sf_locomotion_advance(&after, &body, &state, &action, used, &error), &error);
            this = after;
        }
    }

    /// <summary>How an agent gets on towards its goal; <c>sf_progress</c>.</summary>
    [StructLayout(LayoutKind.Sequential)]
    public struct Progress
    {
        internal uint StructSize;
        /// <summary>1 once the agent was within <see cref="Agents.ReachedWithin"/> of its goal.</summary>
        public int Reached;
        /// <summary>Smallest distance to the goal so far, m.</summary>
        public float BestDistance;
        /// <summary>Decisions since that last shrank; an attempt without a plan is hopeless from 300 on.</summary>
        public uint StalledDecisions;
        /// <summary>Decisions since the goal was set.</summary>
        public uint Decisions;
    }

    /// <summary>What came of a decision in a <see cref="World"/>; <c>sf_outcome</c>.</summary>
    [StructLayout(LayoutKind.Sequential)]
    public struct Outcome
    {
        /// <summary>Reward of the task, for training.</summary>
        public float Reward;
        public AttemptEnd End;
    }
}
