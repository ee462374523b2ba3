// libsurefoot as Unreal sees the world, without types of the engine: centimetres, degrees, z up, left-handed; errors as values, since
// modules of the engine have no exceptions. Everything here is compiled and run by embed/plugins/unreal/check; the components above only move
// actors.
//
// Frames. Unreal's x, y and z are the map's x, z and y, as the engine's glTF importer and exporter have it, and the importer of links. An
// Unreal rotation of 0 faces +x and grows clockwise seen from above; the map's yaw of 0 faces +z, which is Unreal's +y, and grows
// counter-clockwise: each is 90 degrees minus the other. Maps begin at 0 along each axis, wherever the level has its origin: see LevelFrame.
#pragma once

#include "surefoot.h"

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

// What the plugin's editor module uses of the runtime module; the build tool of the engine defines this.
#ifndef SUREFOOT_API
#define SUREFOOT_API
#endif

namespace surefoot {

// Why a call failed, with a text that says what to change; or that it did not.
struct Error {
    sf_status code = SF_OK;
    std::string text;

    bool is_set() const { return code != SF_OK; }
};

// A value, or why there is none.
template <typename Value>
struct Result {
    std::optional<Value> value;
    Error error;

    Result(Value found) : value(std::move(found)) {}
    Result(Error found) : error(std::move(found)) {}

    explicit operator bool() const { return value.has_value(); }
};

// A place, cm, or a velocity, cm/s, on Unreal's axes: the numbers of an FVector.
struct Vector {
    double x = 0.0;
    double y = 0.0;
    double z = 0.0;
};

double distance(const Vector& a, const Vector& b);

// An upright box that the game has put into its level, such as a crate, a barricade or a closed door.
struct Block {
    Vector centre;
    // Half of its size along each axis before it is turned, cm.
    Vector extent;
    double yaw_degrees = 0.0;
};

// Where a level lies on the map that Surefoot made of it.
class SUREFOOT_API LevelFrame {
public:
    // A level whose origin is the map's: one that `surefoot map export` wrote.
    LevelFrame() = default;
    // A level of which Unreal sees the corner of the map, the place with the map's coordinates 0, at `map_corner`, cm.
    explicit LevelFrame(const Vector& map_corner) : map_corner_(map_corner) {}

    // The frame of the level file, .glb, .gltf or .obj, that the graph was proved on.
    static Result<LevelFrame> of_level(const std::string& path);

    const Vector& map_corner() const { return map_corner_; }

    sf_vec3 to_map(const Vector& place) const;
    Vector from_map(const sf_vec3& place) const;
    sf_block to_map_block(const Block& block) const;

    // Velocities and directions have no origin.
    static sf_vec3 to_map_velocity(const Vector& velocity);
    static Vector from_map_velocity(const sf_vec3& velocity);
    // The map's yaw, rad, of a rotation about z, degrees, and back.
    static float to_map_yaw(double degrees);
    static double from_map_yaw(float yaw);

private:
    Vector map_corner_;
};

// A ray to be traced, from end to end.
struct Segment {
    Vector start;
    Vector end;
};

// What a segment ended on; SF_SURFACE_NONE for nothing.
struct SegmentHit {
    double distance = 0.0;
    sf_surface surface = SF_SURFACE_NONE;
};

// Traces many segments in the game's world at once. Segments should pass through characters.
class RayBatch {
public:
    virtual ~RayBatch() = default;
    // Fills `hits`, all nothing before. Must not call the agents for which it traces.
    virtual void trace(const Segment* segments, std::size_t count, SegmentHit* hits) = 0;
};

// A character before a decision.
struct Character {
    Vector feet;
    Vector velocity;
    double yaw_degrees = 0.0;
    bool is_grounded = false;
    // Whether it could jump now, also in the air.
    bool can_jump = false;
};

// What a character does until the next decision; shares are -1 to 1.
struct Controls {
    // Share of the top speed, forward or backward.
    double forward = 0.0;
    // Share of the top speed, to the right or to the left.
    double right = 0.0;
    // Share of the top turning speed; positive turns to the right, and Unreal's rotation grows.
    double turn = 0.0;
    // Jump once, from the ground or again in the air.
    bool jump = false;
};

// A pad, zip line, teleporter or jetpack, on the ground; see sf_device.
struct Device {
    sf_surface kind = SF_SURFACE_PAD;
    bool is_two_way = false;
    Vector from;
    Vector to;
};

struct DestroyHandle {
    void operator()(sf_policy* policy) const { sf_policy_destroy(policy); }
    void operator()(sf_agents* agents) const { sf_agents_destroy(agents); }
    void operator()(sf_graph* graph) const { sf_graph_destroy(graph); }
    void operator()(sf_follower* follower) const { sf_follower_destroy(follower); }
    void operator()(sf_map* map) const { sf_map_destroy(map); }
    void operator()(sf_rehearsals* rehearsals) const { sf_rehearsals_destroy(rehearsals); }
};
template <typename Native>
using Handle = std::unique_ptr<Native, DestroyHandle>;

// The body that policies were trained with, or why the library cannot be used.
Result<sf_body> default_body();

// The minds of characters with equal bodies. One thread at a time. After creation, only set_devices allocates, and texts of errors.
class Agents {
public:
    // Seconds between two decisions.
    static constexpr double decision_seconds = double(SF_TICKS_PER_DECISION) / double(SF_TICKS_PER_SECOND);

    // `policy` is "general-reactive", "general-lstm" or a model's folder; `max_agents` is 1 to 65536.
    static Result<Agents> create(const std::string& policy, const sf_body& body, std::uint32_t max_agents);

    // Where the level lies. To be set before devices and attempts, which keep the frame that they were made in.
    void set_frame(const LevelFrame& frame) { frame_ = frame; }
    const LevelFrame& frame() const { return frame_; }
    std::uint32_t max_agents() const { return max_agents_; }

    Error set_devices(const std::vector<Device>& devices);
    // A character was spawned; `seed` decides its noise.
    Error begin(std::uint32_t agent, std::uint64_t seed);
    // Decides for `count` agents, each with a goal (see Attempt) and at most once in `ids`.
    Error decide(const std::uint32_t* ids, const Character* characters, std::size_t count, RayBatch& rays, Controls* controls,
                 float noise_share = SF_DEFAULT_NOISE);

    // Whether a character has arrived at a goal: it stands within `radius` cm, at most 30 m, no higher or lower than
    // steps and slopes take it, and nothing solid is between. To be asked in every frame; traces two rays, and only if
    // all else is so.
    Result<bool> has_arrived(const Character& character, const Vector& goal, double radius, RayBatch& rays);

    sf_agents* handle() const { return handle_.get(); }

private:
    Agents(Handle<sf_agents> handle, std::uint32_t max_agents);

    void set_states(const Character* characters, std::size_t count);
    void trace(std::size_t count, RayBatch& rays);

    Handle<sf_agents> handle_;
    LevelFrame frame_;
    std::uint32_t max_agents_;
    std::vector<sf_state> states_;
    std::vector<sf_ray> rays_;
    std::vector<sf_hit> hits_;
    std::vector<sf_action> actions_;
    std::vector<Segment> segments_;
    std::vector<SegmentHit> segment_hits_;
};

// How a character moves, for its animation.
class Locomotion {
public:
    // Follows a character for `seconds` to where it is now. It carried out `controls` meanwhile, and used `ability`, SF_WALK for none.
    // Frames may have any length: what is left of a tick of 1/60 s counts with the next one.
    Error advance(const sf_body& body, const Character& character, const Controls& controls, double seconds, sf_ability ability = SF_WALK);

    // What the legs do; in the air, what they did last.
    sf_pace pace() const { return native_.pace; }
    // Phase of a leap, a ride or a fall.
    sf_move_phase phase() const { return native_.phase; }
    // The ability of that leap or ride; SF_WALK in a fall and without a phase.
    sf_ability ability() const { return native_.ability; }
    // Length of a stride, which is two steps, cm; 0 unless the character moves on the ground.
    double stride() const;
    // Share of the stride done, 0 to 1: one foot is put down at 0, the other at 0.5.
    double stride_phase() const { return native_.stride_phase; }
    // Height to add to the drawn character, cm, so that it climbs steps smoothly.
    double step_offset() const;

private:
    sf_locomotion native_{};
    // Time since the last tick, s.
    double seconds_ = 0.0;
    // An ability that was used since then.
    sf_ability used_ = SF_WALK;
};

// A proved graph of a level. Any number of threads may search it.
class Graph {
public:
    // A file of `surefoot graph export --format json`, or its contents.
    static Result<Graph> load(const std::string& path);
    static Result<Graph> load_memory(const void* bytes, std::size_t size);

    // Closes an edge, or opens it again: a door, a bridge, a lift.
    Error set_edge_open(std::uint32_t from, std::uint32_t to, bool is_open);
    Result<sf_graph_info> describe() const;
    // The places of all vertices on the map, m.
    Result<std::vector<sf_vec3>> vertices() const;

    sf_graph* handle() const { return handle_.get(); }

private:
    explicit Graph(Handle<sf_graph> handle) : handle_(std::move(handle)) {}

    Handle<sf_graph> handle_;
};

enum class AttemptState {
    GoesOn,
    // The character stood within the radius of its goal, with nothing solid between.
    Reached,
    // No plan led on, the character died, or it came no closer.
    GaveUp,
    // No path leads to the goal, and the character is as near as it can get.
    Unreachable,
};

// Runs the next legs of plans in a copy of the level, ahead of agents with one policy and body.
class Rehearsals {
public:
    // `policy` and `body` are those of the agents; `level` has the bytes of .sfmap, .glb, .gltf with embedded buffers, or .obj. Rehearsals run
    // on `thread_count` threads of their own, at most 64; with 0 threads they run in Attempt::advance, and repeat themselves.
    static Result<Rehearsals> create(const std::string& policy, const sf_body& body, const void* level, std::size_t size,
                                     std::uint32_t thread_count = 1);

    // Replaces the blocks in the copies of the level, at most 1024: attempts then plan again, and avoid legs on which a block stops their
    // rehearsals. `frame` is the frame of the agents. If a block is refused, all stay as they were.
    Error set_blocks(const std::vector<Block>& blocks, const LevelFrame& frame) const;

    const sf_rehearsals* handle() const { return handle_.get(); }

private:
    explicit Rehearsals(Handle<sf_rehearsals> handle) : handle_(std::move(handle)) {}

    Handle<sf_rehearsals> handle_;
};

// One try of an agent to reach a goal: along plans of a graph, or straight on without one. Agents, graph and rehearsals must outlive it.
class Attempt {
public:
    // Begins an attempt of an agent whose feet are at `feet`. `graph` may be null. `caution` is 0, bold, to 1, careful.
    static Result<Attempt> begin(Agents& agents, std::uint32_t agent, const Graph* graph, const Vector& feet, const Vector& goal, float caution = 1.0f);

    // Whether a place is so near the goal of an attempt that goes on that move_goal serves better than another attempt: within 4 m, or within a
    // quarter of the distance between the character and its goal.
    bool is_near_goal(const Vector& place, const Vector& feet) const;
    // Moves the goal, as often as its target moves: the attempt goes on, and takes another plan once the goal has drifted far. An attempt that
    // has ended stays ended.
    Error move_goal(const Vector& goal, const Vector& feet);
    // Distance from the goal within which the character must stand, cm; 1 m unless it is set.
    void set_radius(double radius) { radius_ = radius; }
    // Rehearses before each decision of an attempt with a graph: the character then moves calmly. Null: it does not.
    void set_rehearsals(const Rehearsals* rehearsals) { rehearsals_ = rehearsals; }
    // Tells, every frame, where the character is, so that it passes nothing unnoticed between decisions.
    Error note(const Character& character, RayBatch& rays);
    // Plans, heads for the next waypoint, or ends the attempt: to be called before each decision of the agent.
    Error advance(const Character& character, RayBatch& rays);
    // The character died.
    Error note_death();

    AttemptState state() const { return state_; }
    const Vector& goal() const { return goal_; }
    // Where the agent heads for now.
    const Vector& waypoint() const { return waypoint_; }

private:
    Attempt(Agents& agents, std::uint32_t agent, const Graph* graph, const Vector& goal, float caution);

    Error note_waypoint(const Character& character, RayBatch& rays);
    Error head_for(const sf_vec3& feet, const sf_vec3& waypoint);
    Error advance_straight(const sf_vec3& feet);
    Error follow(const Character& character);
    // Does what a step says, which may be to take another plan, with a step of its own.
    Error take(sf_step& step, const sf_vec3& feet);
    // Ends the attempt, and adds to the graph what the character met on edges.
    Error end(AttemptState state);

    Agents* agents_;
    std::uint32_t agent_;
    const Graph* graph_;
    Handle<sf_follower> follower_;
    LevelFrame frame_;
    Vector goal_;
    Vector waypoint_;
    float caution_;
    double radius_ = SF_REACHED_WITHIN * 100.0;
    const Rehearsals* rehearsals_ = nullptr;
    bool stands_ = false;
    bool is_at_waypoint_ = false;
    bool needs_plan_ = false;
    // Where a character without a plan stood, on the map, and decisions since it was 1 m away from there.
    sf_vec3 stood_at_{};
    std::uint32_t standing_ = 0;
    AttemptState state_ = AttemptState::GoesOn;
};

}  // namespace surefoot
