/*
 * libsurefoot: policies, plans and worlds of Surefoot as a C library. C99 and C++17.
 *
 * docs/guides/c-library.md is the tutorial; this file is the reference.
 *
 * Units and frames. Metres, seconds, radians; right-handed, y up. A body with yaw 0 faces +z, and yaw grows
 * counter-clockwise seen from above: +x lies to its left. Its feet are the lowest point of its capsule. A decision
 * lasts 1/6 s (SF_TICKS_PER_DECISION ticks of 1/60 s), during which the action is held. Maps begin at 0 along each
 * axis, so a level may lie elsewhere on its map: sf_graph_set_coordinates makes a graph take and give places as they
 * are in the level's file, and sf_frame_to_map and sf_frame_to_level convert others.
 *
 * Errors. Functions return SF_OK or another sf_status. After an error only outputs have changed, unless the function
 * says otherwise. If `error` is not NULL, it gets an English text that names the argument and says what to change.
 *
 * Ownership. The caller owns what a function with `_create`, `_load` or `_shipped` in its name returns, and destroys
 * it once; destroying NULL does nothing. A policy or map may be destroyed before the agents or worlds made from it.
 * Arrays belong to the caller and are not kept beyond the call.
 *
 * Threads. Every function may be called on any thread, and the library has no state besides its handles. Policies,
 * maps and rehearsals never change, and any number of threads may use them. Many threads may search a graph at
 * once; a change waits for searches to end. Agents, followers, worlds and snapshots serve one thread at a time: a
 * second call at the same time returns SF_BUSY. Do not use a handle while it is being destroyed.
 *
 * Compatibility. Programs run with later versions of the library as long as sf_abi_version() stays SF_ABI_VERSION.
 * Structs with a `struct_size` may grow at their end: set it to the struct's size, also in outputs. Other structs
 * never change.
 */
#ifndef SUREFOOT_H
#define SUREFOOT_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* ------------------------------------------------------------ constants */

#define SF_ABI_VERSION 1u
/* Rays of an agent. */
#define SF_RAY_COUNT 64u
/* Reach of every ray, m. */
#define SF_RAY_RANGE 30.0f
/* Distance from a waypoint within which it counts as reached, m, and the usual radius of goals. */
#define SF_REACHED_WITHIN 1.0f
/* Rays from a character to its goal. */
#define SF_ARRIVAL_RAY_COUNT 2u
#define SF_TICKS_PER_SECOND 60u
#define SF_TICKS_PER_DECISION 10u
/* Best share of a policy's exploration noise: some noise frees characters where the mean action runs in circles. */
#define SF_DEFAULT_NOISE 0.5f
/* Most other characters in a state. */
#define SF_MAX_OTHERS 64u
/* Ends of a leg that are not vertices. */
#define SF_STOP_START 0xffffffffu
#define SF_STOP_GOAL 0xfffffffeu

/* Status that functions return. */
typedef int32_t sf_status;
enum {
    SF_OK = 0,
    /* An argument is NULL, not finite, or out of its range. */
    SF_INVALID_ARGUMENT = 1,
    /* An output has too little room; the needed size was written. */
    SF_BUFFER_TOO_SMALL = 2,
    /* A file, a vertex, an edge or an NPC does not exist. */
    SF_NOT_FOUND = 3,
    /* A file is damaged, or of another kind or version. */
    SF_BAD_FILE = 4,
    /* Another call with the same handle is running. */
    SF_BUSY = 5,
    /* Another call has to come first. */
    SF_BAD_STATE = 6,
    /* A fault of the library: destroy the handles of this call. */
    SF_INTERNAL = 7
};

/* Surfaces that rays hit, and kinds of devices. */
typedef int32_t sf_surface;
enum {
    SF_SURFACE_NONE = 0,
    /* Any solid surface. */
    SF_SURFACE_GROUND = 1,
    /* The surface of water, which drowns bodies after five seconds. */
    SF_SURFACE_WATER = 2,
    /* The surface of lava, which kills at once; also any other place where a body must not go. */
    SF_SURFACE_LAVA = 3,
    /* A jump pad, which throws bodies upwards. */
    SF_SURFACE_PAD = 4,
    /* The station at the upper end of a zip line. */
    SF_SURFACE_ZIP_LINE = 5,
    SF_SURFACE_TELEPORTER = 6,
    /* A jetpack to pick up. */
    SF_SURFACE_JETPACK = 7,
    /* A ladder, a net, or a wall that can be climbed. To the eyes of agents it is ground. */
    SF_SURFACE_CLIMB = 8
};

/* The most demanding ability of a leg. */
typedef int32_t sf_ability;
enum {
    SF_WALK = 0,
    SF_JUMP = 1,
    /* A second jump in the air. */
    SF_DOUBLE_JUMP = 2,
    SF_PAD = 3,
    SF_ZIP_LINE = 4,
    SF_TELEPORTER = 5,
    SF_JETPACK = 6,
    /* Climbing a ladder, a net or a wall. */
    SF_CLIMB = 7,
    /* Pulling oneself up to a ledge. */
    SF_MANTLE = 8,
    SF_SWIM = 9,
    /* Crouching under what is lower than the character. */
    SF_CROUCH = 10,
    /* A dash in the air. */
    SF_DASH = 11,
    /* A run along a wall in the air. */
    SF_WALL_RUN = 12,
    /* A slide under what is lower than the character. */
    SF_SLIDE = 13,
    /* Swimming below what reaches into the water. */
    SF_DIVE = 14,
    /* The first of the body's own moves, of which there are at most 16: sf_graph_ability names them. */
    SF_OWN_MOVE = 16
};

/* Sets of abilities, as bits. A set with jumps has double jumps as well. */
enum {
    SF_JUMP_BIT = 1 << SF_JUMP,
    SF_DOUBLE_JUMP_BIT = 1 << SF_DOUBLE_JUMP,
    SF_PAD_BIT = 1 << SF_PAD,
    SF_ZIP_LINE_BIT = 1 << SF_ZIP_LINE,
    SF_TELEPORTER_BIT = 1 << SF_TELEPORTER,
    SF_JETPACK_BIT = 1 << SF_JETPACK,
    SF_CLIMB_BIT = 1 << SF_CLIMB,
    SF_MANTLE_BIT = 1 << SF_MANTLE,
    SF_SWIM_BIT = 1 << SF_SWIM,
    SF_CROUCH_BIT = 1 << SF_CROUCH,
    SF_DASH_BIT = 1 << SF_DASH,
    SF_WALL_RUN_BIT = 1 << SF_WALL_RUN,
    SF_SLIDE_BIT = 1 << SF_SLIDE,
    SF_DIVE_BIT = 1 << SF_DIVE
    /* An own move has the bit 1u << ability. */
};

/* Coordinates of places. */
enum {
    /* Those of the map: metres, y up, from 0 along each axis. */
    SF_COORDINATES_MAP = 0,
    /* Those of the level's file, in its unit and with its axes. */
    SF_COORDINATES_LEVEL = 1
};

/* ------------------------------------------------------------ structs */

typedef struct sf_policy sf_policy;
typedef struct sf_agents sf_agents;
typedef struct sf_graph sf_graph;
typedef struct sf_follower sf_follower;
typedef struct sf_rehearsals sf_rehearsals;
typedef struct sf_map sf_map;
typedef struct sf_world sf_world;
typedef struct sf_snapshot sf_snapshot;

/* Why a call failed: its status, and a zero-terminated text in UTF-8. */
typedef struct sf_error {
    sf_status code;
    char message[256];
} sf_error;

/* A place, m, a velocity, m/s, or a direction: finite values up to a million. */
typedef struct sf_vec3 {
    float x;
    float y;
    float z;
} sf_vec3;

/* A place of a level in the coordinates of its file, in double precision: levels may lie far from their origin. */
typedef struct sf_place {
    double x;
    double y;
    double z;
} sf_place;

/* How the coordinates of a level's file relate to the map's. */
typedef struct sf_frame {
    /* Position of the level's origin on the map, m. */
    sf_place origin;
    /* Metres per unit of the level, above 0. */
    double scale;
    /* 1 if z is up in the level: its (x, y, z) is (x, z, -y) on the map. 0 if y is up. */
    int32_t z_up;
} sf_frame;

typedef struct sf_ray {
    sf_vec3 origin;
    /* Of length 1. */
    sf_vec3 direction;
} sf_ray;

/* The hit of a ray. All zeros: no hit within SF_RAY_RANGE. */
typedef struct sf_hit {
    /* Distance to the surface, m, 0 or more; ignored for SF_SURFACE_NONE. Beyond SF_RAY_RANGE it counts as no hit. */
    float distance;
    /* Distance to another character, m, also behind the surface; 0 for none. Only for policies that see others.
     * Characters do not stop rays. */
    float body_distance;
    sf_surface surface;
} sf_hit;

/* The controls of a character for one decision, each from -1 to 1. */
typedef struct sf_action {
    /* Moves forward (positive) or backward, as a share of the top speed. */
    float forward;
    /* Moves to the right (positive) or to the left. */
    float strafe;
    /* Turns to the left (positive: yaw grows) or to the right, as a share of the top turning speed. */
    float turn;
    /* Jumps once if positive, from the ground or again in the air. */
    float jump;
} sf_action;

/* Another character that an agent sees. */
typedef struct sf_other {
    sf_vec3 feet;
    sf_vec3 velocity;
} sf_other;

/* A device of the level. Agents sense the nearest ones. */
typedef struct sf_device {
    /* SF_SURFACE_PAD, SF_SURFACE_ZIP_LINE, SF_SURFACE_TELEPORTER or SF_SURFACE_JETPACK. */
    sf_surface kind;
    /* 1 for a teleporter that works in both directions. */
    int32_t two_way;
    /* Centre of a pad or jetpack, or the entrance, on the ground, m. */
    sf_vec3 from;
    /* End of a zip line or teleporter, on the ground, m; ignored for other devices. */
    sf_vec3 to;
} sf_device;

/* The body of a character. Policies were trained mostly with the paper's body, the default with steps of 0.1 m;
 * general-reactive observes these values and adapts to other bodies. sf_body_default fills it; ranges are in parentheses. */
typedef struct sf_body {
    uint32_t struct_size;
    /* m (2 radii to 4). */
    float height;
    /* m (0.15 to 1). */
    float radius;
    /* Top speed forward, m/s (0.1 to 20). */
    float forward_speed;
    /* Top speed backwards and sideways as a share of forward_speed (0 to 1). */
    float side_speed_share;
    /* Top turning speed, rad/s (0.1 to 20). */
    float turn_speed;
    /* Upward speed of a jump, m/s (0 to 30). */
    float jump_speed;
    /* m/s2 (1 to 100). */
    float gravity;
    /* Steepest walkable slope, rad (0 to 1.4). */
    float max_slope;
    /* Highest step without a jump, m (0 to half of the height). */
    float step_height;
    /* Horizontal acceleration on the ground, m/s2 (1 to 1000). */
    float ground_acceleration;
    /* Horizontal acceleration in the air, m/s2 (0 to 1000). */
    float air_acceleration;
    /* Speed on zip lines, m/s (1 to 40). Only worlds use this and the next two. */
    float zip_line_speed;
    /* Upward acceleration of a jetpack, m/s2 (0 to 200). */
    float jetpack_acceleration;
    /* Upward speed at which a jetpack stops pushing, m/s (0 to 40). */
    float jetpack_climb_speed;
    /* Jumps in the air before the character must land (0 to 255). */
    uint32_t extra_jumps;
    /* Ticks after leaving the ground in which a jump counts as a jump from the ground (0 to 254). Only worlds use
     * this. */
    uint32_t coyote_ticks;
    /* Whether the character can use zip lines, 0 or 1. */
    int32_t uses_zip_lines;
    /* Whether the character can use jetpacks, 0 or 1. */
    int32_t uses_jetpacks;
    /* Speed up ladders and other faces that can be climbed, m/s (0 to 10); 0 if the character cannot climb. */
    float climb_speed;
    /* Greatest height above its feet of a ledge to which the character pulls itself up, m (0 to 2 height); 0 if it
     * cannot. Only worlds use this. */
    float mantle_height;
    /* Speed in water that is too deep to wade, m/s (0 to 10); 0 if it cannot swim. Only worlds use this. */
    float swim_speed;
    /* Height of the character when it crouches, m (0, or 2 radius to height); 0 if it cannot. Only worlds use this. */
    float crouch_height;
    /* Speed of the dash that the character makes when it jumps in the air and has no jump left, m/s (0 to 40); 0 if it
     * makes none. Only worlds use this. */
    float dash_speed;
    /* How long the character runs along a wall in the air, s: 0 (it cannot) to 10. */
    float wall_run_seconds;
    /* How long the character keeps its speed under what is lower than it, s: 0 to 10; needs a crouch_height. */
    float slide_seconds;
    /* How long the character can be under water, s: 0 (it cannot dive) to 600; needs a swim_speed. */
    float dive_seconds;
} sf_body;

/* Flags of a state. */
enum {
    /* The character stands on walkable ground. */
    SF_GROUNDED = 1,
    /* It can jump now, from the ground or in the air; implied by SF_GROUNDED. */
    SF_CAN_JUMP = 2,
    /* It rides a zip line. */
    SF_RIDES = 4
};

/* Where a character is and how it moves. In an array, all elements have the first one's struct_size. */
typedef struct sf_state {
    uint32_t struct_size;
    /* Sum of SF_GROUNDED, SF_CAN_JUMP and SF_RIDES. */
    uint32_t flags;
    sf_vec3 feet;
    sf_vec3 velocity;
    /* rad, any finite value. */
    float yaw;
    /* Share of the breath used up under water, 0 to 1, in steps of 1/300. */
    float breath_used;
    /* Thrust left in the jetpack, s, 0 or more; 0 without a jetpack. */
    float jetpack_seconds;
    /* Number of others, at most SF_MAX_OTHERS; 0 unless the policy sees others. */
    uint32_t other_count;
    /* Others in sight, in any order; NULL for none. The nearest four within 12 m count. */
    const sf_other* others;
} sf_state;

/* What the legs of a character do. The speeds depend on the height of its body. */
typedef int32_t sf_pace;
enum {
    /* It stands. */
    SF_PACE_IDLE = 0,
    /* It turns in place. */
    SF_PACE_TURN = 1,
    /* It walks: up to 2.2 m/s for a body of 1.8 m. */
    SF_PACE_WALK = 2,
    SF_PACE_RUN = 3,
    /* It moves, but its action brings it to rest. */
    SF_PACE_STOP = 4
};

/* Phase of a leap, a ride or a fall. */
typedef int32_t sf_move_phase;
enum {
    /* None: the character stands, walks or runs. */
    SF_MOVE_NONE = 0,
    /* It is in the air, or rides a zip line. */
    SF_MOVE_FLIGHT = 1,
    /* It has come down within the last 0.2 s. */
    SF_MOVE_LANDING = 2
};

/* How a character moves, for animation. All zeros but struct_size: one that stands. */
typedef struct sf_locomotion {
    uint32_t struct_size;
    /* What its legs do; in the air, what they did last. */
    sf_pace pace;
    sf_move_phase phase;
    /* The ability of its leap, climb, swim or ride; SF_WALK in a fall and without a phase. */
    sf_ability ability;
    /* Length of a stride, which is two steps, m; 0 unless it moves on the ground. */
    float stride;
    /* Share of the stride done, 0 to 1: one foot is put down at 0, the other at 0.5. */
    float stride_phase;
    /* Ticks in the air, or since the landing. */
    uint32_t ticks;
    /* 1 in the air because of an ability. */
    int32_t was_thrown;
    /* Height to add to the drawn character, m, so that its height changes smoothly over steps: up to the body's
     * step_height, and negative after a step up. It decays with a time constant of 0.1 s, or as fast as the character
     * moves. 0 on rides and after a teleport. */
    float step_offset;
    /* Height of the feet at the last tick, m, and how much they rose in it, m. */
    float feet_height;
    float rise;
    /* 1 if it stood on ground at the last tick. */
    int32_t was_grounded;
} sf_locomotion;

/* Progress of an agent towards its goal. */
typedef struct sf_progress {
    uint32_t struct_size;
    /* 1 after the agent has been within SF_REACHED_WITHIN of its goal. */
    int32_t reached;
    /* Smallest distance to the goal so far, m. */
    float best_distance;
    /* Decisions since best_distance last shrank; at 300, an attempt without a plan is hopeless. */
    uint32_t stalled_decisions;
    /* Decisions since the goal was set. */
    uint32_t decisions;
} sf_progress;

/* The ends of a leg: vertices, SF_STOP_START or SF_STOP_GOAL. */
typedef struct sf_leg_key {
    uint32_t from;
    uint32_t to;
} sf_leg_key;

/* A request for a plan. */
typedef struct sf_query {
    uint32_t struct_size;
    /* Abilities that the plan must not use: a sum of SF_..._BIT; 0 for none. */
    uint32_t without;
    sf_vec3 start;
    sf_vec3 goal;
    /* How much the plan avoids death: 0 is bold, 1 is careful and the fastest to find. */
    float caution;
    /* Number of legs to avoid. */
    uint32_t avoid_count;
    /* Legs that the plan must not use; NULL for none. */
    const sf_leg_key* avoid;
} sf_query;

/* A leg of a plan. */
typedef struct sf_leg {
    /* Where it ends. */
    sf_vec3 waypoint;
    sf_leg_key key;
    sf_ability ability;
    /* Expected duration, including the cost of failures, s. */
    float seconds;
    /* Estimated chance of success, 0 to 1. */
    float chance;
    /* Estimated chance of dying, 0 to 1 - chance. */
    float death_chance;
} sf_leg;

/* Why there is no path. */
typedef int32_t sf_no_path;
enum {
    SF_PATH_FOUND = 0,
    /* No vertex near the start has an edge that leaves it. */
    SF_START_OFF_GRAPH = 1,
    /* No vertex near the goal has an edge that reaches it. */
    SF_GOAL_OFF_GRAPH = 2,
    /* No path joins the islands of start and goal, in either direction. */
    SF_DIFFERENT_ISLANDS = 3,
    /* A path leads from the goal to the start, but none from the start to the goal. */
    SF_ONE_WAY = 4,
    /* The goal is in a zone that the plan must not enter. Queries of this library have no zones yet. */
    SF_GOAL_IN_ZONE = 5
};

/* A whole plan. A plan without a path is an answer, not an error. */
typedef struct sf_plan {
    /* Index of its first leg in the array of legs. */
    uint32_t first_leg;
    uint32_t leg_count;
    /* Expected duration, including the cost of failures, s. */
    float seconds;
    /* Estimated chance that every leg succeeds, 0 to 1. */
    float chance;
    /* Estimated chance of arriving, including re-plans after failed legs, 0 to 1; 0 without a path. */
    float arrival_chance;
    /* Estimated chance of dying on the way, 0 to 1. */
    float death_chance;
    sf_no_path no_path;
    /* 1 if there is no path and the plan leads to the reachable place nearest to the goal. If there is neither, the
     * plan is one leg straight to the goal. */
    int32_t leads_near;
} sf_plan;

/* A directed edge of a graph. */
typedef struct sf_edge {
    sf_leg_key key;
    sf_ability ability;
    /* 0 if sf_graph_set_edge_open closed it. */
    int32_t is_open;
    /* As in a leg, with the values from the proof. */
    float seconds;
    float chance;
    float death_chance;
    /* Current cost in a careful search, in decisions; infinite if closed. */
    float cost;
} sf_edge;

typedef struct sf_graph_info {
    uint32_t struct_size;
    uint32_t vertex_count;
    uint32_t edge_count;
    /* Number of strongly connected components. */
    uint32_t island_count;
} sf_graph_info;

/* An ability of the body of a graph. */
typedef struct sf_ability_info {
    uint32_t struct_size;
    /* Name in snake case, as queries and links have it: `jump`, or that of one of the body's own moves. */
    char name[36];
    /* What the game plays meanwhile, from the file of the move; otherwise the name. */
    char animation[132];
} sf_ability_info;

typedef int32_t sf_edit_kind;
enum {
    /* Removes an edge. */
    SF_FORBID_EDGE = 1,
    /* Adds an edge, proved or not; `value` is its duration, 0 to 3600 s, or negative for an estimate. */
    SF_FORCE_EDGE = 2,
    /* Multiplies the cost of an edge by `value`, 0.1 to 1000. */
    SF_PRICE_EDGE = 3,
    /* Removes a vertex and its edges. */
    SF_REMOVE_VERTEX = 4
};

/* A designer's edit. It names vertices by place, so that it stays valid after a new build of the graph. */
typedef struct sf_edit {
    sf_edit_kind kind;
    float value;
    /* Place of the vertex, or of the edge's first vertex, within 3 m. */
    sf_vec3 from;
    /* Place of the edge's last vertex, within 3 m. */
    sf_vec3 to;
} sf_edit;

/* One traversal of an edge by an NPC. */
typedef struct sf_traversal {
    sf_leg_key key;
    /* Duration in decisions. */
    uint32_t decisions;
    /* One of sf_traversal_end. */
    int32_t end;
} sf_traversal;

enum { SF_ARRIVED = 0, SF_FAILED = 1, SF_DIED = 2 };

/* The next step of an NPC. */
typedef int32_t sf_step_kind;
enum {
    /* Keep heading for the waypoint. */
    SF_STEP_KEEP = 0,
    /* Head for the waypoint from now on. */
    SF_STEP_HEAD = 1,
    /* Call sf_follower_plan. */
    SF_STEP_PLAN = 2,
    /* Stop: the attempt has failed. */
    SF_STEP_GIVE_UP = 3,
    /* Stop: no path leads to the goal, and the NPC is as near as it can get. */
    SF_STEP_UNREACHABLE = 4
};

typedef struct sf_step {
    uint32_t struct_size;
    sf_step_kind kind;
    /* The waypoint; zeros without a plan. */
    sf_vec3 waypoint;
    /* Index of the current leg. */
    uint32_t leg;
    /* Number of legs of the plan; 0 without a plan. */
    uint32_t leg_count;
    /* Number of plans so far. */
    uint32_t plans;
    /* 1 if the NPC must stand at the waypoint: at the goal, and where it leaps from rest. 0 if it may pass the waypoint
     * on the run or in flight, or if there is no plan. */
    int32_t stands;
} sf_step;

/* How an NPC that rehearses goes where it can walk; ranges are in parentheses. Leaps and devices are not limited by
 * it. sf_gait_named fills it. */
typedef struct sf_gait {
    uint32_t struct_size;
    /* Top speed, as a share of the body's (0.05 to 1). */
    float speed;
    /* Acceleration, as a share of the body's on the ground (0.05 to 1). */
    float acceleration;
    /* Turning speed, as a share of the body's (0.05 to 1). */
    float turn_rate;
    /* Distance that the NPC keeps from walls and rims where there is room, beyond its radius, m (0 to 2). */
    float wall_distance;
    /* 1 if plans use jumps only where no other route leads to the goal. */
    int32_t avoids_jumps;
} sf_gait;

/* An upright box that the game has put into its level, such as a crate, a barricade or a closed door. */
typedef struct sf_block {
    /* Middle of its bottom on the map, m. */
    sf_vec3 foot;
    /* Extents along x and z before it is turned, and upwards, m (0.05 to 1000). */
    float width;
    float depth;
    float height;
    /* Turn about the upright axis, rad, counter-clockwise seen from above. */
    float yaw;
} sf_block;

/* How an attempt of an NPC of a world ended. */
typedef int32_t sf_end;
enum {
    SF_GOES_ON = 0,
    SF_REACHED = 1,
    /* Left the map. */
    SF_FELL = 2,
    SF_BURNT = 3,
    SF_DROWNED = 4,
    /* 300 decisions without coming closer. */
    SF_NO_PROGRESS = 5,
    SF_UNREACHABLE = 6,
    /* Other NPCs stand at the goal. Worlds of this library do not end attempts so. */
    SF_REACHED_NEAR = 7
};

/* The outcome of a decision. */
typedef struct sf_outcome {
    /* Reward of the task, for training. */
    float reward;
    sf_end end;
} sf_outcome;

/* Casts rays in the caller's world: fills `hits`, which are zeros, with the hit of each of `rays`. It must not call
 * the agents that called it, and it must return: no exception, no longjmp. */
typedef void (*sf_cast_rays)(void* user, const sf_ray* rays, size_t ray_count, sf_hit* hits);

/* ------------------------------------------------------------ library */

/* Version of the library, such as "0.3.0"; do not free it. */
const char* sf_version(void);
/* SF_ABI_VERSION of the library: compare it with the header's before any other call. */
uint32_t sf_abi_version(void);
/* Fills `body`, including struct_size, with the body of training: 1.8 m tall, 11 m/s, a double jump. */
sf_status sf_body_default(sf_body* body, sf_error* error);

/* ------------------------------------------------------------ policies */

/* The built-in policy `name`: "general-reactive" or "general-lstm"; NULL for the first. */
sf_status sf_policy_shipped(const char* name, sf_policy** policy, sf_error* error);
/* Reads a model's folder, which has manifest.json and weights.bpk. SF_NOT_FOUND, SF_BAD_FILE. */
sf_status sf_policy_load(const char* path, sf_policy** policy, sf_error* error);
/* Decodes the contents of these two files. SF_BAD_FILE. */
sf_status sf_policy_load_memory(const void* manifest, size_t manifest_size, const void* weights, size_t weights_size,
    sf_policy** policy, sf_error* error);
/* Number of values of an observation (369, or 461 for a policy that sees others) and of an agent's memory (0 for a
 * reactive policy). */
sf_status sf_policy_lengths(const sf_policy* policy, size_t* observation_length, size_t* memory_length,
    sf_error* error);
/* Name and shortened hash of the weights, such as "general-reactive (e892d7d5da9b)". `length` includes the zero and
 * is at most 64. */
sf_status sf_policy_label(const sf_policy* policy, char* label, size_t capacity, size_t* length, sf_error* error);
void sf_policy_destroy(sf_policy* policy);

/* ------------------------------------------------------------ agents
 *
 * An agent is the mind of one character. Once in ten ticks, for any number of agents together, call:
 *
 *   sf_agents_observe (or sf_agents_observe_with)   to pass what they see
 *   sf_agents_decide                                to get their actions for the next ten ticks
 *
 * After sf_agents_create these calls allocate nothing, nor do sf_agents_rays, _begin, _set_goal, _note, _acted,
 * _save and _restore. `ids` are numbers of agents, 0 to max_agents - 1, each at most once; NULL stands for 0, 1, 2
 * and so on. */

/* Makes room for agents with bodies like `body`; NULL for the default body. `max_agents` is 1 to 65536. */
sf_status sf_agents_create(const sf_policy* policy, const sf_body* body, uint32_t max_agents, sf_agents** agents,
    sf_error* error);
void sf_agents_destroy(sf_agents* agents);
/* Replaces the devices that agents sense within 50 m; at most 20000. Allocates. */
sf_status sf_agents_set_devices(sf_agents* agents, const sf_device* devices, size_t count, sf_error* error);
/* Clears everything that an agent remembers, including its goal, for a new character. `seed` determines its noise. */
sf_status sf_agents_begin(sf_agents* agents, uint32_t agent, uint64_t seed, sf_error* error);
/* Gives an agent, whose feet are at `feet`, a goal or the next waypoint. It keeps its memory, and its progress starts
 * again. To follow a goal that moves, call it before sf_agents_observe of each decision: an agent that was observed has
 * to be observed again. */
sf_status sf_agents_set_goal(sf_agents* agents, uint32_t agent, sf_vec3 feet, sf_vec3 goal, sf_error* error);
/* Reports the position of an agent between decisions, and returns whether it has reached its goal; `reached` may be
 * NULL. Call it every tick to notice a goal that the agent passes. */
sf_status sf_agents_note(sf_agents* agents, uint32_t agent, sf_vec3 feet, int32_t* reached, sf_error* error);
/* Fills `rays` with the rays of `count` characters, SF_RAY_COUNT for each. `ray_capacity` is the capacity in rays. */
sf_status sf_agents_rays(const sf_agents* agents, const sf_state* states, size_t count, sf_ray* rays,
    size_t ray_capacity, sf_error* error);
/* Follows how a character moves by one tick of 1/60 s, in which it carried out `action`, used `ability`, an sf_ability
 * (SF_WALK for none), and came to `state`. `body` may be NULL for the default body. Servers also send where their NPCs
 * will be in the next second (Movement in movement.proto), because their workers rehearse. */
sf_status sf_locomotion_advance(sf_locomotion* locomotion, const sf_body* body, const sf_state* state,
    const sf_action* action, int32_t ability, sf_error* error);
/* Fills `rays` with the rays from a character to `goal`, which the level must not stop: SF_ARRIVAL_RAY_COUNT of them,
 * at a quarter and three quarters of its height. There are none where the character has not arrived anyway: it does
 * not stand on the ground (SF_GROUNDED), or its feet are more than `radius`, 0 to 30 m, from the goal, or higher or
 * lower than it by more than 0.6 m and more than a step and the steepest slope over that distance explain. */
sf_status sf_agents_arrival_rays(const sf_agents* agents, const sf_state* state, sf_vec3 goal, float radius,
    sf_ray* rays, size_t capacity, size_t* count, sf_error* error);
/* Whether a character has arrived at `goal`, by the rule of sf_agents_arrival_rays: it stands near the goal, and
 * `hits`, those of these rays, have nothing solid before the goal. Without rays, pass NULL for `hits`. Call it every
 * tick, to end the attempt on the ground and on the right side of walls and floors. */
sf_status sf_agents_has_arrived(const sf_agents* agents, const sf_state* state, sf_vec3 goal, float radius,
    const sf_hit* hits, int32_t* arrived, sf_error* error);
/* Observes `count` agents: `states` has the state and `hits` the SF_RAY_COUNT hits of each. After an error, all
 * agents before the one that the error names are observed. */
sf_status sf_agents_observe(sf_agents* agents, const uint32_t* ids, const sf_state* states, const sf_hit* hits,
    size_t count, sf_error* error);
/* Like sf_agents_observe, but calls `cast_rays` once for the rays of all agents; `user` is passed to it. */
sf_status sf_agents_observe_with(sf_agents* agents, const uint32_t* ids, const sf_state* states, size_t count,
    sf_cast_rays cast_rays, void* user, sf_error* error);
/* Copies the last observation of an agent. */
sf_status sf_agents_observation(const sf_agents* agents, uint32_t agent, float* values, size_t capacity, size_t* count,
    sf_error* error);
/* Decides for `count` agents that were observed: the policy's mean action plus `noise_share`, 0 to 1, of its
 * exploration noise. The action of an agent depends, to the bit, only on its own seed and past, not on other agents;
 * processors may differ in rounding. */
sf_status sf_agents_decide(sf_agents* agents, const uint32_t* ids, size_t count, float noise_share, sf_action* actions,
    sf_error* error);
/* Reports that characters carry out other actions than decided. */
sf_status sf_agents_acted(sf_agents* agents, const uint32_t* ids, const sf_action* actions, size_t count,
    sf_error* error);
sf_status sf_agents_progress(const sf_agents* agents, uint32_t agent, sf_progress* progress, sf_error* error);
/* Copies the whole state of an agent, for rollbacks: `size` bytes, equal for all agents of a policy. The bytes may
 * be stored, for the same version of the library and the same policy. */
sf_status sf_agents_save(const sf_agents* agents, uint32_t agent, void* bytes, size_t capacity, size_t* size,
    sf_error* error);
/* SF_BAD_FILE if the bytes are not a saved agent. */
sf_status sf_agents_restore(sf_agents* agents, uint32_t agent, const void* bytes, size_t size, sf_error* error);

/* ------------------------------------------------------------ graphs */

/* Reads a graph that `surefoot graph export --format json` wrote, and prepares it for queries: up to a second for
 * 1600 vertices. SF_NOT_FOUND, SF_BAD_FILE. */
sf_status sf_graph_load(const char* path, sf_graph** graph, sf_error* error);
sf_status sf_graph_load_memory(const void* bytes, size_t size, sf_graph** graph, sf_error* error);
void sf_graph_destroy(sf_graph* graph);
sf_status sf_graph_describe(const sf_graph* graph, sf_graph_info* info, sf_error* error);
/* Copies the places of all vertices, in the order of their numbers. */
sf_status sf_graph_vertices(const sf_graph* graph, sf_vec3* vertices, size_t capacity, size_t* count, sf_error* error);
/* Copies all edges with their current costs. */
sf_status sf_graph_edges(const sf_graph* graph, sf_edge* edges, size_t capacity, size_t* count, sf_error* error);
/* How the coordinates of the level relate to the map's. SF_NOT_FOUND if the file does not say. */
sf_status sf_graph_frame(const sf_graph* graph, sf_frame* frame, sf_error* error);
/* What an ability of the body is called, own moves included. `graph` may be NULL: then there are no own moves.
 * SF_NOT_FOUND for an own move that the body does not have. */
sf_status sf_graph_ability(const sf_graph* graph, int32_t ability, sf_ability_info* info, sf_error* error);
/* Sets the coordinates of all places that the graph takes and gives: in queries, plans, vertices and edits. Initially
 * SF_COORDINATES_MAP. SF_NOT_FOUND for SF_COORDINATES_LEVEL if the file does not say where the level lies. */
sf_status sf_graph_set_coordinates(sf_graph* graph, int32_t coordinates, sf_error* error);
/* Closes an edge or opens it again, with immediate effect: a door, a bridge, a lift. SF_NOT_FOUND. */
sf_status sf_graph_set_edge_open(sf_graph* graph, uint32_t from, uint32_t to, int32_t is_open, sf_error* error);
/* Multiplies the proved cost of an edge by a factor, 0.1 to 1000, with immediate effect; 1 undoes it. With factors
 * below 1, plans may not be the cheapest. SF_NOT_FOUND. */
sf_status sf_graph_set_edge_price(sf_graph* graph, uint32_t from, uint32_t to, float factor, sf_error* error);
/* Replaces all designers' edits, initially none, and prepares the graph again, which takes as long as loading.
 * Closed edges, prices and traversals are reset. SF_NOT_FOUND, without any change, if an edit finds nothing to
 * change. */
sf_status sf_graph_edit(sf_graph* graph, const sf_edit* edits, size_t count, sf_error* error);
/* Adds traversals to the evidence of edges, so that plans avoid edges that fail. Traversals before an invalid one
 * are added. */
sf_status sf_graph_note_traversals(sf_graph* graph, const sf_traversal* traversals, size_t count, sf_error* error);
/* Finds the cheapest plan: `count` legs and, unless `plan` is NULL, the whole plan. Without a path the plan gives
 * the reason and leads as near to the goal as paths lead. */
sf_status sf_graph_find_path(const sf_graph* graph, const sf_query* query, sf_leg* legs, size_t capacity, size_t* count,
    sf_plan* plan, sf_error* error);
/* Finds up to `plan_capacity` plans, 1 to 64: the cheapest, then plans without one of its legs, the cheapest first.
 * Plans are written even if there is too little room for legs. */
sf_status sf_graph_find_alternatives(const sf_graph* graph, const sf_query* query, sf_plan* plans, size_t plan_capacity,
    size_t* plan_count, sf_leg* legs, size_t leg_capacity, size_t* leg_count, sf_error* error);

/* ------------------------------------------------------------ followers
 *
 * A follower is an attempt at a goal by plan, with the rules of NPCs on a server. It goes from waypoint to waypoint;
 * after 50 decisions without progress it takes another plan without the legs that failed. It neither senses nor
 * moves anything. */

/* Begins an attempt at a goal, without a plan. All places of the follower are on the map. */
sf_status sf_follower_create(sf_vec3 goal, sf_follower** follower, sf_error* error);
/* The same with all places of the follower in the coordinates that the graph has now. */
sf_status sf_follower_create_on(const sf_graph* graph, sf_vec3 goal, sf_follower** follower, sf_error* error);
void sf_follower_destroy(sf_follower* follower);
/* Makes `to` the same attempt as `from`, for rollbacks: its plan, its legs that failed, and its traversals. Both may be
 * followers of other goals. */
sf_status sf_follower_copy(const sf_follower* from, sf_follower* to, sf_error* error);
/* Reports, once for every decision, the position of the feet and whether they came within SF_REACHED_WITHIN of the
 * waypoint. If `stands` of the last step is 1, pass the result of sf_agents_has_arrived instead: the NPC may pass
 * other waypoints in flight.
 * The caller checks whether the goal is reached: at the last waypoint, unless the plan leads near. */
sf_status sf_follower_advance(sf_follower* follower, sf_vec3 feet, int32_t reached, sf_step* step, sf_error* error);
/* Moves the goal of the attempt; `feet` and `reached` are as in sf_follower_advance. Call it whenever the target has
 * moved, such as before each decision, instead of beginning another attempt. The last leg then leads to the new goal:
 * the step is SF_STEP_HEAD if that changes the waypoint, otherwise SF_STEP_KEEP. Moves of up to 0.5 m, or 15 % of the
 * distance between feet and goal, wait until the waypoint is reached. The step is SF_STEP_PLAN without a plan, and once
 * the goal is more than 1 m and 25 % of that distance away from where it was at the last plan. Until
 * sf_follower_plan is called, the follower keeps its plan. A follower that has ended stays ended. */
sf_status sf_follower_move_goal(sf_follower* follower, sf_vec3 goal, sf_vec3 feet, int32_t reached, sf_step* step,
    sf_error* error);
/* Plans from `feet`, without the legs that have failed, and follows that plan. `caution` and `without` are as in a
 * query. */
sf_status sf_follower_plan(sf_follower* follower, const sf_graph* graph, sf_vec3 feet, float caution, uint32_t without,
    sf_step* step, sf_error* error);
/* Creates rehearsals of legs for NPCs on `map`. Pass the body and the policy of their agents. Rehearsals run on
 * `thread_count` threads of their own, 0 to 64. With 0 threads they run in the calls of sf_follower_prepare, and equal
 * inputs give equal results. Any number of threads may use the handle. Destroy it when no call is using it; the policy
 * and the map may be destroyed before. Each rehearsal begins with the movers in their initial state. */
sf_status sf_rehearsals_create(const sf_policy* policy, const sf_map* map, const sf_body* body, uint32_t thread_count,
    sf_rehearsals** rehearsals, sf_error* error);
void sf_rehearsals_destroy(sf_rehearsals* rehearsals);
/* Puts exactly these blocks into the copies of the level, at most 1024; none removes all. NPCs then take another plan at
 * their next decision, and avoid legs on which a block stops their rehearsals. Call it when a block has come to rest,
 * from any thread. If a block is refused, all stay as they were. */
sf_status sf_rehearsals_set_blocks(const sf_rehearsals* rehearsals, const sf_block* blocks, size_t count,
    sf_error* error);
/* Prepares the next decision of an agent, after sf_follower_advance and before sf_agents_observe: smooths the plan,
 * rehearses the next two legs in a copy of the level, and lets the agent move calmly where a rehearsal has arrived.
 * `state` is as in sf_agents_observe. `origin` is the position on the map of the origin of the agent's coordinates, m;
 * zeros if the agent uses the map's. Do what the step says and call the function again, until the step is SF_STEP_KEEP:
 * after SF_STEP_HEAD call sf_agents_set_goal, after SF_STEP_PLAN call sf_follower_plan. An agent that stands waits up
 * to 1.5 s for its first rehearsal. If the character strays more than 0.4 m from its rehearsal, another rehearsal
 * begins. SF_BAD_STATE: the agent has no goal. */
sf_status sf_follower_prepare(sf_follower* follower, const sf_rehearsals* rehearsals, sf_agents* agents, uint32_t agent,
    const sf_state* state, sf_vec3 origin, sf_step* step, sf_error* error);
/* Fills `gait`, including struct_size, with the gait `name`: "walk" (1.4 m/s for the default body), "jog", "run" (the
 * default), "careful" or "hurried". SF_NOT_FOUND: no gait has that name. */
sf_status sf_gait_named(const char* name, sf_gait* gait, sf_error* error);
/* Changes the gait of the NPC, at any time. Without sf_follower_prepare only `avoids_jumps` has an effect. The step is
 * SF_STEP_PLAN if the NPC would now take another route, otherwise SF_STEP_KEEP. */
sf_status sf_follower_set_gait(sf_follower* follower, const sf_gait* gait, sf_step* step, sf_error* error);
/* Reports that the NPC died, which ends the attempt. */
sf_status sf_follower_note_death(sf_follower* follower, sf_error* error);
/* Copies the legs of the current plan. */
sf_status sf_follower_legs(const sf_follower* follower, sf_leg* legs, size_t capacity, size_t* count, sf_error* error);
/* Copies and clears the traversals since the last call: pass them to sf_graph_note_traversals. If there is too
 * little room, none is cleared. */
sf_status sf_follower_take_traversals(sf_follower* follower, sf_traversal* traversals, size_t capacity, size_t* count,
    sf_error* error);

/* ------------------------------------------------------------ worlds
 *
 * The simulation in which policies were trained, for games without physics of their own, for tests, and for
 * rollbacks. */

/* Reads a level: .sfmap, .glb, .gltf with embedded buffers, or .obj. SF_NOT_FOUND, SF_BAD_FILE. */
sf_status sf_map_load(const char* path, sf_map** map, sf_error* error);
sf_status sf_map_load_memory(const void* bytes, size_t size, sf_map** map, sf_error* error);
void sf_map_destroy(sf_map* map);
/* The map's extent along each axis, from 0, and the level's own origin on the map. */
sf_status sf_map_extent(const sf_map* map, sf_vec3* extent, sf_vec3* origin, sf_error* error);
/* How the coordinates of the level relate to the map's. */
sf_status sf_map_frame(const sf_map* map, sf_frame* frame, sf_error* error);
/* A place of the level on the map, m. */
sf_status sf_frame_to_map(const sf_frame* frame, sf_place place, sf_vec3* on_map, sf_error* error);
/* A place of the map, m, in the coordinates of the level. */
sf_status sf_frame_to_level(const sf_frame* frame, sf_vec3 place, sf_place* in_level, sf_error* error);
/* Copies the devices of the level, for sf_agents_set_devices. */
sf_status sf_map_devices(const sf_map* map, sf_device* devices, size_t capacity, size_t* count, sf_error* error);
/* A world without NPCs on the map, for bodies like `body`; NULL for the default body. */
sf_status sf_world_create(const sf_map* map, const sf_body* body, sf_world** world, sf_error* error);
void sf_world_destroy(sf_world* world);
/* Adds an NPC at rest, and writes its number. Numbers of despawned NPCs are reused. */
sf_status sf_world_spawn(sf_world* world, sf_vec3 feet, float yaw, uint32_t* npc, sf_error* error);
sf_status sf_world_despawn(sf_world* world, uint32_t npc, sf_error* error);
/* Starts an attempt at a goal; the body keeps its motion. */
sf_status sf_world_set_goal(sf_world* world, uint32_t npc, sf_vec3 goal, sf_error* error);
/* Begins a decision: the action is held until the next one. */
sf_status sf_world_decide(sf_world* world, uint32_t npc, sf_action action, sf_error* error);
/* Advances the world by 1/60 s. `tick`, the number of ticks so far, may be NULL. */
sf_status sf_world_tick(sf_world* world, uint64_t* tick, sf_error* error);
/* Ends a decision. SF_BAD_STATE without a goal. */
sf_status sf_world_close_decision(sf_world* world, uint32_t npc, sf_outcome* outcome, sf_error* error);
/* A whole decision of `count` NPCs, each with a goal: decides, ticks ten times, closes. */
sf_status sf_world_step(sf_world* world, const uint32_t* npcs, const sf_action* actions, sf_outcome* outcomes,
    size_t count, sf_error* error);
/* The state of an NPC, as agents observe it. */
sf_status sf_world_state(const sf_world* world, uint32_t npc, sf_state* state, sf_error* error);
/* The hits of the SF_RAY_COUNT rays of an NPC. */
sf_status sf_world_look(const sf_world* world, uint32_t npc, sf_hit* hits, size_t capacity, sf_error* error);
/* Casts any rays at the map, within SF_RAY_RANGE. */
sf_status sf_world_cast_rays(const sf_world* world, const sf_ray* rays, size_t count, sf_hit* hits, sf_error* error);
/* The observation of an NPC as the simulation writes it. It equals, to the bit, the observation of an agent that
 * gets sf_map_devices, sf_world_state and sf_world_look, and sf_agents_note every tick. */
sf_status sf_world_observation(const sf_world* world, uint32_t npc, float* values, size_t capacity, size_t* count,
    sf_error* error);
/* An empty snapshot, which can be reused. */
sf_status sf_snapshot_create(sf_snapshot** snapshot, sf_error* error);
void sf_snapshot_destroy(sf_snapshot* snapshot);
/* Copies the state of a world, including all NPCs, into the snapshot. */
sf_status sf_world_save(const sf_world* world, sf_snapshot* snapshot, sf_error* error);
/* Restores a snapshot in this world or in another world on the same map; the same actions then lead to the same
 * bits. */
sf_status sf_world_restore(sf_world* world, const sf_snapshot* snapshot, sf_error* error);

#ifdef __cplusplus
}
#endif

#endif
