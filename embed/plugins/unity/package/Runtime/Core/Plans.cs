// Plans and what they are made of. All structs are laid out as those of surefoot.h, which is the reference for ranges.
using System;
using System.Runtime.InteropServices;

namespace Surefoot
{
    /// <summary>The ends of a leg or edge: numbers of vertices, <see cref="Start"/> or <see cref="Goal"/>; <c>sf_leg_key</c>.</summary>
    [StructLayout(LayoutKind.Sequential)]
    public struct LegKey : IEquatable<LegKey>
    {
        /// <summary>The query's start instead of a vertex.</summary>
        public const uint Start = 0xffffffff;
        /// <summary>The query's goal instead of a vertex.</summary>
        public const uint Goal = 0xfffffffe;

        public uint From;
        public uint To;

        public LegKey(uint from, uint to)
        {
            From = from;
            To = to;
        }

        /// <summary>Whether both ends are vertices, so that the leg runs along an edge of the graph.</summary>
        public bool IsEdge => From != Start && To != Goal;

        public bool Equals(LegKey other) => From == other.From && To == other.To;

        public override bool Equals(object other) => other is LegKey && Equals((LegKey)other);

        public override int GetHashCode() => (int)(From * 397 ^ To);

        public override string ToString() => $"{Name(From)} -> {Name(To)}";

        private static string Name(uint stop) => stop == Start ? "start" : stop == Goal ? "goal" : stop.ToString();
    }

    /// <summary>What a plan must do.</summary>
    public struct PathQuery
    {
        public Vec3 Start;
        public Vec3 Goal;
        /// <summary>How much the plan does to avoid that the NPC dies: 0 bold to 1 careful, which is fastest to find.</summary>
        public float Caution;
        /// <summary>Abilities that the plan does without.</summary>
        public Abilities Without;

        /// <summary>A careful plan for all abilities.</summary>
        public PathQuery(Vec3 start, Vec3 goal)
        {
            Start = start;
            Goal = goal;
            Caution = 1;
            Without = Abilities.None;
        }
    }

    /// <summary>A leg of a plan; <c>sf_leg</c>.</summary>
    [StructLayout(LayoutKind.Sequential)]
    public struct Leg
    {
        /// <summary>Where the leg ends.</summary>
        public Vec3 Waypoint;
        public LegKey Key;
        public Ability Ability;
        /// <summary>Expected duration, what failures cost included, s.</summary>
        public float Seconds;
        /// <summary>Estimated chance of success, 0 to 1.</summary>
        public float Chance;
        /// <summary>Estimated chance of dying, 0 to 1 - <see cref="Chance"/>.</summary>
        public float DeathChance;
    }

    /// <summary>A plan as a whole; <c>sf_plan</c>. A plan without a path is an answer and no error.</summary>
    [StructLayout(LayoutKind.Sequential)]
    public struct Plan
    {
        internal uint FirstLeg;
        public uint LegCount;
        /// <summary>Expected duration, what failures cost included, s.</summary>
        public float Seconds;
        /// <summary>Estimated chance that every leg succeeds, 0 to 1.</summary>
        public float Chance;
        /// <summary>Estimated chance of arriving, with other plans where legs fail, 0 to 1; 0 without a path.</summary>
        public float ArrivalChance;
        /// <summary>Estimated chance of dying on the way, 0 to 1.</summary>
        public float DeathChance;
        public NoPath NoPath;
        /// <summary>
        /// 1 if there is no path, and the plan leads to the reachable place nearest to the goal. With neither a path nor this, the plan is one
        /// leg straight to the goal.
        /// </summary>
        public int LeadsNear;
    }

    /// <summary>A plan with its legs.</summary>
    public sealed class PlannedPath
    {
        internal PlannedPath(Plan plan, Leg[] legs)
        {
            Plan = plan;
            Legs = legs;
        }

        public Plan Plan { get; }

        /// <summary>The legs in order; leg i ends at waypoint i.</summary>
        public Leg[] Legs { get; }

        public bool IsFound => Plan.NoPath == NoPath.PathFound;
    }

    /// <summary>A directed edge of a graph; <c>sf_edge</c>.</summary>
    [StructLayout(LayoutKind.Sequential)]
    public struct Edge
    {
        public LegKey Key;
        public Ability Ability;
        /// <summary>0 if <see cref="Graph.SetEdgeOpen"/> closed the edge.</summary>
        public int IsOpen;
        /// <summary>Expected duration as it was proved, s.</summary>
        public float Seconds;
        /// <summary>Chance of success as it was proved, 0 to 1.</summary>
        public float Chance;
        /// <summary>Chance of dying as it was proved, 0 to 1.</summary>
        public float DeathChance;
        /// <summary>What a careful search adds up now, in decisions; infinite if closed.</summary>
        public float Cost;
    }

    /// <summary>How large a graph is; <c>sf_graph_info</c>.</summary>
    [StructLayout(LayoutKind.Sequential)]
    public struct GraphInfo
    {
        internal uint StructSize;
        public uint VertexCount;
        public uint EdgeCount;
        /// <summary>Number of strongly connected components.</summary>
        public uint IslandCount;
    }

    /// <summary>A designer's edit, which names vertices by places within 3 m; <c>sf_edit</c>.</summary>
    [StructLayout(LayoutKind.Sequential)]
    public struct Edit
    {
        public EditKind Kind;
        public float Value;
        /// <summary>Place of the vertex, or of the one that the edge leaves, m.</summary>
        public Vec3 From;
        /// <summary>Place of the vertex that the edge reaches, m.</summary>
        public Vec3 To;
    }

    /// <summary>How an NPC got along an edge; <c>sf_traversal</c>.</summary>
    [StructLayout(LayoutKind.Sequential)]
    public struct Traversal
    {
        public LegKey Key;
        /// <summary>How long the traversal took.</summary>
        public uint Decisions;
        public TraversalEnd End;
    }

    /// <summary>How an NPC that rehearses goes where it can walk; <c>sf_gait</c>. Begin with <see cref="Named"/>.</summary>
    [StructLayout(LayoutKind.Sequential)]
    public struct Gait
    {
        internal uint StructSize;
        /// <summary>Top speed, as a share of the body's, 0.05 to 1.</summary>
        public float Speed;
        /// <summary>Acceleration, as a share of the body's on the ground, 0.05 to 1.</summary>
        public float Acceleration;
        /// <summary>Turning speed, as a share of the body's, 0.05 to 1.</summary>
        public float TurnRate;
        /// <summary>Distance from walls and rims that it keeps besides its radius where there is room, m, 0 to 2.</summary>
        public float WallDistance;
        /// <summary>1 if plans use jumps only where no other way leads to the goal.</summary>
        public int AvoidsJumps;

        /// <summary>"walk", "jog", "run" (the usual one), "careful" or "hurried".</summary>
        public static unsafe Gait Named(string name)
        {
            Library.RequireLoaded();
            NativeError error;
            Gait gait;
            fixed (byte* text = Native.Utf8(nameof(name), name))
            {
                Native.Check(NativeMethods.sf_gait_named(text, &gait, &error), &error);
            }
            return gait;
        }
    }

    /// <summary>What a <see cref="Follower"/> wants the NPC to do; <c>sf_step</c>.</summary>
    [StructLayout(LayoutKind.Sequential)]
    public struct FollowStep
    {
        internal uint StructSize;
        public StepKind Kind;
        /// <summary>Where the NPC heads for; zeros without a plan.</summary>
        public Vec3 Waypoint;
        /// <summary>Index of the current leg.</summary>
        public uint Leg;
        /// <summary>Number of legs of the plan; 0 without one.</summary>
        public uint LegCount;
        /// <summary>Number of plans so far.</summary>
        public uint Plans;
        /// <summary>1 if the NPC must stand at the waypoint, 0 if it passes it on the run or in flight.</summary>
        public int Stands;
    }
}
