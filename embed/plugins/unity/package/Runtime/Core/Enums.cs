using System;

namespace Surefoot
{
    /// <summary>What a call of the library returned; <c>sf_status</c>.</summary>
    public enum Status
    {
        Ok = 0,
        /// <summary>An argument is missing, not finite, or out of its range.</summary>
        InvalidArgument = 1,
        /// <summary>An output has too little room.</summary>
        BufferTooSmall = 2,
        /// <summary>A file, a vertex, an edge or an NPC does not exist.</summary>
        NotFound = 3,
        /// <summary>A file is damaged, or of another kind or version.</summary>
        BadFile = 4,
        /// <summary>Another thread is using the same object.</summary>
        Busy = 5,
        /// <summary>A call is missing that has to come before.</summary>
        BadState = 6,
        /// <summary>A fault of the library: dispose the objects of this call.</summary>
        Internal = 7,
    }

    /// <summary>Coordinates of places.</summary>
    public enum Coordinates
    {
        /// <summary>Those of the map: metres, y up, from 0 along each axis.</summary>
        Map = 0,
        /// <summary>Those of the level's file, in its unit and with its axes.</summary>
        Level = 1,
    }

    /// <summary>What rays end on, and kinds of devices; <c>sf_surface</c>.</summary>
    public enum Surface
    {
        /// <summary>Nothing within <see cref="Agents.RayRange"/>.</summary>
        None = 0,
        /// <summary>Solid ground.</summary>
        Ground = 1,
        /// <summary>The surface of water, which drowns bodies after five seconds.</summary>
        Water = 2,
        /// <summary>Lava, which kills at once; also any other place where a body must not go.</summary>
        Lava = 3,
        /// <summary>A jump pad, which throws bodies upwards.</summary>
        Pad = 4,
        /// <summary>The station at the upper end of a zip line.</summary>
        ZipLine = 5,
        Teleporter = 6,
        /// <summary>A jetpack to pick up.</summary>
        Jetpack = 7,
        /// <summary>A ladder, a net, or a wall that can be climbed. To the eyes of agents it is ground.</summary>
        Climb = 8,
    }

    /// <summary>The most demanding ability that a leg takes; <c>sf_ability</c>.</summary>
    public enum Ability
    {
        Walk = 0,
        Jump = 1,
        /// <summary>A second jump in the air.</summary>
        DoubleJump = 2,
        Pad = 3,
        ZipLine = 4,
        Teleporter = 5,
        Jetpack = 6,
        /// <summary>Climbing a ladder, a net or a wall.</summary>
        Climb = 7,
        /// <summary>Pulling oneself up to a ledge.</summary>
        Mantle = 8,
        Swim = 9,
        /// <summary>Crouching under what is lower than the character.</summary>
        Crouch = 10,
        /// <summary>A dash in the air.</summary>
        Dash = 11,
        /// <summary>A run along a wall in the air.</summary>
        WallRun = 12,
        /// <summary>A slide under what is lower than the character.</summary>
        Slide = 13,
        /// <summary>Swimming below what reaches into the water.</summary>
        Dive = 14,
        /// <summary>The first of the body's own moves, of which there are at most 16.</summary>
        OwnMove = 16,
    }

    /// <summary>A set of abilities. One with jumps has double jumps as well.</summary>
    [Flags]
    public enum Abilities : uint
    {
        None = 0,
        Jump = 1u << Ability.Jump,
        DoubleJump = 1u << Ability.DoubleJump,
        Pad = 1u << Ability.Pad,
        ZipLine = 1u << Ability.ZipLine,
        Teleporter = 1u << Ability.Teleporter,
        Jetpack = 1u << Ability.Jetpack,
        Climb = 1u << Ability.Climb,
        Mantle = 1u << Ability.Mantle,
        Swim = 1u << Ability.Swim,
        Crouch = 1u << Ability.Crouch,
        Dash = 1u << Ability.Dash,
        WallRun = 1u << Ability.WallRun,
        Slide = 1u << Ability.Slide,
        Dive = 1u << Ability.Dive,
        /// <summary>All of the body's own moves; one of them has the bit `1u &lt;&lt; ability`.</summary>
        OwnMoves = 0xFFFF0000u,
    }

    /// <summary>What the legs of a character do; <c>sf_pace</c>.</summary>
    public enum Pace
    {
        Idle = 0,
        /// <summary>It turns in place.</summary>
        Turn = 1,
        /// <summary>It walks: up to 2.2 m/s for a body of 1.8 m.</summary>
        Walk = 2,
        Run = 3,
        /// <summary>It moves, but its action brings it to rest.</summary>
        Stop = 4,
    }

    /// <summary>Phase of a leap, a ride or a fall; <c>sf_move_phase</c>.</summary>
    public enum MovePhase
    {
        None = 0,
        Flight = 1,
        /// <summary>It has come down within the last 0.2 s.</summary>
        Landing = 2,
    }

    /// <summary>Flags of a <see cref="CharacterState"/>.</summary>
    [Flags]
    public enum StateFlags : uint
    {
        /// <summary>The character is in the air and has no jump left.</summary>
        None = 0,
        /// <summary>The character stands on walkable ground.</summary>
        Grounded = 1,
        /// <summary>It can jump now, from the ground or in the air; implied by <see cref="Grounded"/>.</summary>
        CanJump = 2,
        /// <summary>It rides a zip line.</summary>
        Rides = 4,
    }

    /// <summary>Why there is no path; <c>sf_no_path</c>.</summary>
    public enum NoPath
    {
        /// <summary>There is a path.</summary>
        PathFound = 0,
        /// <summary>No vertex near the start has an edge that leaves it.</summary>
        StartOffGraph = 1,
        /// <summary>No vertex near the goal has an edge that reaches it.</summary>
        GoalOffGraph = 2,
        /// <summary>No path joins the islands of start and goal in either direction.</summary>
        DifferentIslands = 3,
        /// <summary>A path leads from the goal to the start, but none from the start to the goal.</summary>
        OneWay = 4,
        /// <summary>The goal is in a zone that the plan must not enter.</summary>
        GoalInZone = 5,
    }

    /// <summary>What a <see cref="Follower"/> wants the NPC to do; <c>sf_step_kind</c>.</summary>
    public enum StepKind
    {
        /// <summary>Keep heading for the waypoint.</summary>
        Keep = 0,
        /// <summary>Head for the waypoint from now on.</summary>
        Head = 1,
        /// <summary>Call <see cref="Follower.PlanFrom"/>.</summary>
        Plan = 2,
        /// <summary>Stop: the attempt has failed.</summary>
        GiveUp = 3,
        /// <summary>Stop: no path leads to the goal, and the NPC is as near as it can get.</summary>
        Unreachable = 4,
    }

    /// <summary>A designer's kind of edit; <c>sf_edit_kind</c>.</summary>
    public enum EditKind
    {
        /// <summary>Removes an edge.</summary>
        ForbidEdge = 1,
        /// <summary>Adds an edge, proved or not; the value is its duration, 0 to 3600 s, below 0 for an estimate.</summary>
        ForceEdge = 2,
        /// <summary>Multiplies the cost of an edge by the value, 0.1 to 1000.</summary>
        PriceEdge = 3,
        /// <summary>Removes a vertex and its edges.</summary>
        RemoveVertex = 4,
    }

    /// <summary>How a traversal of an edge ended.</summary>
    public enum TraversalEnd
    {
        Arrived = 0,
        Failed = 1,
        Died = 2,
    }

    /// <summary>How an attempt of an NPC of a <see cref="World"/> ended; <c>sf_end</c>.</summary>
    public enum AttemptEnd
    {
        GoesOn = 0,
        Reached = 1,
        /// <summary>The NPC left the map.</summary>
        Fell = 2,
        Burnt = 3,
        Drowned = 4,
        /// <summary>The NPC came no closer for 300 decisions.</summary>
        NoProgress = 5,
        Unreachable = 6,
        /// <summary>Other NPCs stand at the goal.</summary>
        ReachedNear = 7,
    }
}
