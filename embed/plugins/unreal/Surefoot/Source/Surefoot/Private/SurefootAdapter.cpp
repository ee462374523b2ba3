#include "SurefootAdapter.h"

#include <algorithm>
#include <cmath>
#include <iterator>

namespace surefoot {

namespace {

constexpr double cm_per_metre = 100.0;
constexpr double degrees_per_radian = 57.29577951308232;
// Decisions without coming closer after which an attempt without a plan is hopeless.
constexpr std::uint32_t hopeless_after = 300;
// How far a place is from the goal at most to be near it: in cm, and as a share of the character's distance from the goal.
constexpr double near_cm = 400.0;
constexpr double near_share = 0.25;
constexpr double tick_seconds = 1.0 / double(SF_TICKS_PER_SECOND);
// Of a longer frame, such as one in which a level was loaded, only so much is followed, s.
constexpr double longest_frame = 0.25;
// A waypoint within 1 cm of the goal is the goal: places are rounded on their way to the map and back.
constexpr double same_cm = 1.0;

// Makes a call, which gets an error last, and keeps what it says.
template <typename Call, typename... Arguments>
Error error_of(Call call, Arguments... arguments) {
    sf_error native;
    const sf_status status = call(arguments..., &native);
    return status == SF_OK ? Error{} : Error{status, native.message};
}

// The header that this file was compiled with and the library that is loaded must fit.
Error check_version() {
    if (sf_abi_version() == SF_ABI_VERSION) {
        return {};
    }
    return {SF_BAD_FILE, "libsurefoot has interface version " + std::to_string(sf_abi_version()) + ", but the plugin was built for "
                             + std::to_string(SF_ABI_VERSION) + ": take library and surefoot.h from one release"};
}

float distance_on_map(const sf_vec3& a, const sf_vec3& b) {
    return std::hypot(a.x - b.x, a.y - b.y, a.z - b.z);
}

Result<Handle<sf_policy>> load_policy(const std::string& policy) {
    const bool is_folder = policy.find_first_of("/\\") != std::string::npos;
    sf_policy* handle = nullptr;
    const Error error = error_of(is_folder ? sf_policy_load : sf_policy_shipped, policy.c_str(), &handle);
    if (error.is_set()) {
        return error;
    }
    return Handle<sf_policy>(handle);
}

sf_state state_of(const Character& character, const LevelFrame& frame) {
    sf_state state{};
    state.struct_size = sizeof state;
    state.flags = character.is_grounded ? SF_GROUNDED | SF_CAN_JUMP : character.can_jump ? SF_CAN_JUMP : 0;
    state.feet = frame.to_map(character.feet);
    state.velocity = LevelFrame::to_map_velocity(character.velocity);
    state.yaw = LevelFrame::to_map_yaw(character.yaw_degrees);
    return state;
}

Segment segment_of(const sf_ray& ray, const LevelFrame& frame) {
    const sf_vec3 end{ray.origin.x + ray.direction.x * SF_RAY_RANGE, ray.origin.y + ray.direction.y * SF_RAY_RANGE,
                      ray.origin.z + ray.direction.z * SF_RAY_RANGE};
    return {frame.from_map(ray.origin), frame.from_map(end)};
}

sf_hit hit_of(const SegmentHit& hit) {
    return {float(hit.distance / cm_per_metre), 0.0f, hit.surface};
}

Controls controls_of(const sf_action& action) {
    // The policy turns to the left with positive values.
    return {action.forward, action.strafe, -action.turn, action.jump > 0.0f};
}

sf_action action_of(const Controls& controls) {
    return {float(controls.forward), float(controls.right), float(-controls.turn), controls.jump ? 1.0f : -1.0f};
}

}  // namespace

double distance(const Vector& a, const Vector& b) {
    return std::hypot(a.x - b.x, a.y - b.y, a.z - b.z);
}

// ----------------------------------------------------------------------------------------------------------------- frames

Result<LevelFrame> LevelFrame::of_level(const std::string& path) {
    sf_map* native = nullptr;
    const Error error = error_of(sf_map_load, path.c_str(), &native);
    if (error.is_set()) {
        return error;
    }
    const Handle<sf_map> map(native);
    sf_vec3 extent, origin;
    const Error failure = error_of(sf_map_extent, static_cast<const sf_map*>(map.get()), &extent, &origin);
    if (failure.is_set()) {
        return failure;
    }
    return LevelFrame(from_map_velocity({-origin.x, -origin.y, -origin.z}));
}

sf_vec3 LevelFrame::to_map(const Vector& place) const {
    return to_map_velocity({place.x - map_corner_.x, place.y - map_corner_.y, place.z - map_corner_.z});
}

Vector LevelFrame::from_map(const sf_vec3& place) const {
    const Vector from_corner = from_map_velocity(place);
    return {from_corner.x + map_corner_.x, from_corner.y + map_corner_.y, from_corner.z + map_corner_.z};
}

sf_vec3 LevelFrame::to_map_velocity(const Vector& velocity) {
    return {float(velocity.x / cm_per_metre), float(velocity.z / cm_per_metre), float(velocity.y / cm_per_metre)};
}

Vector LevelFrame::from_map_velocity(const sf_vec3& velocity) {
    return {velocity.x * cm_per_metre, velocity.z * cm_per_metre, velocity.y * cm_per_metre};
}

float LevelFrame::to_map_yaw(double degrees) {
    return float((90.0 - degrees) / degrees_per_radian);
}

double LevelFrame::from_map_yaw(float yaw) {
    return 90.0 - yaw * degrees_per_radian;
}

sf_block LevelFrame::to_map_block(const Block& block) const {
    const sf_vec3 half = to_map_velocity(block.extent);
    const sf_vec3 foot = to_map({block.centre.x, block.centre.y, block.centre.z - block.extent.z});
    // A turn has no direction of its own, unlike what faces +x or +z.
    return {foot, 2.0f * half.x, 2.0f * half.z, 2.0f * half.y, float(-block.yaw_degrees / degrees_per_radian)};
}

// ----------------------------------------------------------------------------------------------------------------- agents

Result<sf_body> default_body() {
    const Error version = check_version();
    if (version.is_set()) {
        return version;
    }
    sf_body body{};
    const Error error = error_of(sf_body_default, &body);
    if (error.is_set()) {
        return error;
    }
    return body;
}

Agents::Agents(Handle<sf_agents> handle, std::uint32_t max_agents)
    : handle_(std::move(handle)),
      max_agents_(max_agents),
      states_(max_agents),
      rays_(std::size_t(max_agents) * SF_RAY_COUNT),
      hits_(rays_.size()),
      actions_(max_agents),
      segments_(rays_.size()),
      segment_hits_(rays_.size()) {}

Result<Agents> Agents::create(const std::string& policy, const sf_body& body, std::uint32_t max_agents) {
    const Error version = check_version();
    if (version.is_set()) {
        return version;
    }
    const Result<Handle<sf_policy>> weights = load_policy(policy);
    if (!weights) {
        return weights.error;
    }
    sf_agents* native = nullptr;
    const Error error = error_of(sf_agents_create, static_cast<const sf_policy*>(weights.value->get()), &body, max_agents, &native);
    if (error.is_set()) {
        return error;
    }
    return Agents(Handle<sf_agents>(native), max_agents);
}

Error Agents::set_devices(const std::vector<Device>& devices) {
    std::vector<sf_device> natives;
    natives.reserve(devices.size());
    for (const Device& device : devices) {
        natives.push_back({device.kind, device.is_two_way, frame_.to_map(device.from), frame_.to_map(device.to)});
    }
    return error_of(sf_agents_set_devices, handle(), static_cast<const sf_device*>(natives.data()), natives.size());
}

Error Agents::begin(std::uint32_t agent, std::uint64_t seed) {
    return error_of(sf_agents_begin, handle(), agent, seed);
}

Error Agents::decide(const std::uint32_t* ids, const Character* characters, std::size_t count, RayBatch& rays, Controls* controls,
                     float noise_share) {
    if (count > max_agents_) {
        return {SF_INVALID_ARGUMENT,
                "count is " + std::to_string(count) + ", but there is room for " + std::to_string(max_agents_) + ": raise max_agents"};
    }
    if (count == 0) {
        return {};
    }
    set_states(characters, count);
    Error error = error_of(sf_agents_rays, static_cast<const sf_agents*>(handle()), static_cast<const sf_state*>(states_.data()), count,
                           rays_.data(), rays_.size());
    if (error.is_set()) {
        return error;
    }
    trace(count, rays);
    error = error_of(sf_agents_observe, handle(), ids, static_cast<const sf_state*>(states_.data()), static_cast<const sf_hit*>(hits_.data()), count);
    if (error.is_set()) {
        return error;
    }
    error = error_of(sf_agents_decide, handle(), ids, count, noise_share, actions_.data());
    if (!error.is_set()) {
        std::transform(actions_.data(), actions_.data() + count, controls, controls_of);
    }
    return error;
}

Result<bool> Agents::has_arrived(const Character& character, const Vector& goal, double radius, RayBatch& rays) {
    const sf_state state = state_of(character, frame_);
    const sf_vec3 goal_on_map = frame_.to_map(goal);
    const float metres = float(radius / cm_per_metre);
    const auto* agents = static_cast<const sf_agents*>(handle());
    sf_ray lines[SF_ARRIVAL_RAY_COUNT];
    std::size_t count = 0;
    const std::size_t room = SF_ARRIVAL_RAY_COUNT;
    Error error = error_of(sf_agents_arrival_rays, agents, &state, goal_on_map, metres, lines, room, &count);
    if (error.is_set()) {
        return error;
    }
    if (count == 0) {
        return false;
    }
    Segment segments[SF_ARRIVAL_RAY_COUNT];
    SegmentHit segment_hits[SF_ARRIVAL_RAY_COUNT];
    sf_hit found[SF_ARRIVAL_RAY_COUNT];
    std::transform(lines, lines + count, segments, [this](const sf_ray& line) { return segment_of(line, frame_); });
    rays.trace(segments, count, segment_hits);
    std::transform(segment_hits, segment_hits + count, found, hit_of);
    const sf_hit* hits = found;
    std::int32_t arrived = 0;
    error = error_of(sf_agents_has_arrived, agents, &state, goal_on_map, metres, hits, &arrived);
    if (error.is_set()) {
        return error;
    }
    return arrived != 0;
}

void Agents::set_states(const Character* characters, std::size_t count) {
    std::transform(characters, characters + count, states_.data(), [this](const Character& character) { return state_of(character, frame_); });
}

void Agents::trace(std::size_t count, RayBatch& rays) {
    const std::size_t ray_count = count * SF_RAY_COUNT;
    std::transform(rays_.data(), rays_.data() + ray_count, segments_.data(), [this](const sf_ray& ray) { return segment_of(ray, frame_); });
    std::fill_n(segment_hits_.data(), ray_count, SegmentHit{});
    rays.trace(segments_.data(), ray_count, segment_hits_.data());
    std::transform(segment_hits_.data(), segment_hits_.data() + ray_count, hits_.data(), hit_of);
}

// ----------------------------------------------------------------------------------------------------------------- animation

Error Locomotion::advance(const sf_body& body, const Character& character, const Controls& controls, double seconds, sf_ability ability) {
    seconds_ = std::min(seconds_ + seconds, longest_frame);
    used_ = ability == SF_WALK ? used_ : ability;
    // The origin of a level only shifts the feet, and their height counts from tick to tick.
    const sf_state state = state_of(character, LevelFrame());
    const sf_action action = action_of(controls);
    Error error;
    for (; seconds_ >= tick_seconds && !error.is_set(); seconds_ -= tick_seconds) {
        native_.struct_size = sizeof native_;
        error = error_of(sf_locomotion_advance, &native_, &body, &state, &action, used_);
        used_ = SF_WALK;
    }
    return error;
}

double Locomotion::stride() const {
    return native_.stride * cm_per_metre;
}

double Locomotion::step_offset() const {
    return native_.step_offset * cm_per_metre;
}

// ----------------------------------------------------------------------------------------------------------------- graphs

Result<Graph> Graph::load(const std::string& path) {
    sf_graph* native = nullptr;
    const Error error = error_of(sf_graph_load, path.c_str(), &native);
    if (error.is_set()) {
        return error;
    }
    return Graph(Handle<sf_graph>(native));
}

Result<Graph> Graph::load_memory(const void* bytes, std::size_t size) {
    sf_graph* native = nullptr;
    const Error error = error_of(sf_graph_load_memory, bytes, size, &native);
    if (error.is_set()) {
        return error;
    }
    return Graph(Handle<sf_graph>(native));
}

Error Graph::set_edge_open(std::uint32_t from, std::uint32_t to, bool is_open) {
    return error_of(sf_graph_set_edge_open, handle(), from, to, std::int32_t(is_open));
}

Result<sf_graph_info> Graph::describe() const {
    sf_graph_info info{};
    info.struct_size = sizeof info;
    const Error error = error_of(sf_graph_describe, static_cast<const sf_graph*>(handle()), &info);
    if (error.is_set()) {
        return error;
    }
    return info;
}

Result<std::vector<sf_vec3>> Graph::vertices() const {
    const Result<sf_graph_info> info = describe();
    if (!info) {
        return info.error;
    }
    std::vector<sf_vec3> places(info.value->vertex_count);
    std::size_t count = 0;
    const Error error = error_of(sf_graph_vertices, static_cast<const sf_graph*>(handle()), places.data(), places.size(), &count);
    if (error.is_set()) {
        return error;
    }
    return places;
}

// ----------------------------------------------------------------------------------------------------------------- rehearsals

Result<Rehearsals> Rehearsals::create(const std::string& policy, const sf_body& body, const void* level, std::size_t size,
                                      std::uint32_t thread_count) {
    const Result<Handle<sf_policy>> weights = load_policy(policy);
    if (!weights) {
        return weights.error;
    }
    sf_map* loaded = nullptr;
    Error error = error_of(sf_map_load_memory, level, size, &loaded);
    const Handle<sf_map> map(loaded);
    sf_rehearsals* native = nullptr;
    if (!error.is_set()) {
        error = error_of(sf_rehearsals_create, static_cast<const sf_policy*>(weights.value->get()), static_cast<const sf_map*>(map.get()), &body,
                         thread_count, &native);
    }
    if (error.is_set()) {
        return error;
    }
    return Rehearsals(Handle<sf_rehearsals>(native));
}

Error Rehearsals::set_blocks(const std::vector<Block>& blocks, const LevelFrame& frame) const {
    std::vector<sf_block> natives;
    natives.reserve(blocks.size());
    std::transform(blocks.begin(), blocks.end(), std::back_inserter(natives), [&frame](const Block& block) { return frame.to_map_block(block); });
    return error_of(sf_rehearsals_set_blocks, handle(), static_cast<const sf_block*>(natives.data()), natives.size());
}

// ----------------------------------------------------------------------------------------------------------------- attempts

Attempt::Attempt(Agents& agents, std::uint32_t agent, const Graph* graph, const Vector& goal, float caution)
    : agents_(&agents), agent_(agent), graph_(graph), frame_(agents.frame()), goal_(goal), waypoint_(goal), caution_(caution) {}

Result<Attempt> Attempt::begin(Agents& agents, std::uint32_t agent, const Graph* graph, const Vector& feet, const Vector& goal, float caution) {
    Attempt attempt(agents, agent, graph, goal, caution);
    const sf_vec3 goal_on_map = attempt.frame_.to_map(goal);
    Error error = attempt.head_for(attempt.frame_.to_map(feet), goal_on_map);
    if (!error.is_set() && graph != nullptr) {
        sf_follower* native = nullptr;
        error = error_of(sf_follower_create, goal_on_map, &native);
        attempt.follower_.reset(native);
    }
    if (error.is_set()) {
        return error;
    }
    return attempt;
}

bool Attempt::is_near_goal(const Vector& place, const Vector& feet) const {
    return state_ == AttemptState::GoesOn && distance(place, goal_) <= std::max(near_cm, near_share * distance(feet, goal_));
}

Error Attempt::move_goal(const Vector& goal, const Vector& feet) {
    if (state_ != AttemptState::GoesOn) {
        return {};
    }
    const sf_vec3 feet_on_map = frame_.to_map(feet), goal_on_map = frame_.to_map(goal);
    sf_step step{};
    step.struct_size = sizeof step;
    Error error;
    if (follower_) {
        error = error_of(sf_follower_move_goal, follower_.get(), goal_on_map, feet_on_map, std::int32_t(is_at_waypoint_), &step);
        needs_plan_ = error.is_set() ? needs_plan_ : step.kind == SF_STEP_PLAN;
    } else if (distance(goal, goal_) != 0.0) {
        step.kind = SF_STEP_HEAD;
        step.waypoint = goal_on_map;
    }
    if (!error.is_set() && step.kind == SF_STEP_HEAD) {
        error = head_for(feet_on_map, step.waypoint);
    }
    if (!error.is_set()) {
        goal_ = goal;
    }
    return error;
}

Error Attempt::note(const Character& character, RayBatch& rays) {
    if (state_ != AttemptState::GoesOn) {
        return {};
    }
    const Error error = note_waypoint(character, rays);
    if (error.is_set()) {
        return error;
    }
    const Result<bool> arrived = agents_->has_arrived(character, goal_, radius_, rays);
    if (!arrived || !*arrived.value) {
        return arrived.error;
    }
    if (follower_) {
        // The follower notes the end of its last traversal; nothing follows from its answer any more.
        sf_step step{};
        step.struct_size = sizeof step;
        const sf_vec3 feet = frame_.to_map(character.feet);
        const std::int32_t reached = is_at_waypoint_;
        const Error failure = error_of(sf_follower_advance, follower_.get(), feet, reached, &step);
        if (failure.is_set()) {
            return failure;
        }
    }
    return end(AttemptState::Reached);
}

Error Attempt::advance(const Character& character, RayBatch& rays) {
    const Error error = note(character, rays);
    if (error.is_set() || state_ != AttemptState::GoesOn) {
        return error;
    }
    const sf_vec3 feet = frame_.to_map(character.feet);
    return follower_ ? follow(character) : advance_straight(feet);
}

Error Attempt::note_death() {
    if (state_ != AttemptState::GoesOn) {
        return {};
    }
    const Error error = follower_ ? error_of(sf_follower_note_death, follower_.get()) : Error{};
    return error.is_set() ? error : end(AttemptState::GaveUp);
}

Error Attempt::note_waypoint(const Character& character, RayBatch& rays) {
    std::int32_t passed = 0;
    const Error error = error_of(sf_agents_note, agents_->handle(), agent_, frame_.to_map(character.feet), &passed);
    if (error.is_set() || !stands_) {
        is_at_waypoint_ = is_at_waypoint_ || passed != 0;
        return error;
    }
    // Waypoints are passed on the run or in flight, but at some the character stands. If that is the goal itself, the
    // follower counts the time until the character has arrived there.
    if (distance(waypoint_, goal_) <= same_cm) {
        return {};
    }
    const Result<bool> arrived = agents_->has_arrived(character, waypoint_, SF_REACHED_WITHIN * cm_per_metre, rays);
    is_at_waypoint_ = is_at_waypoint_ || (arrived && *arrived.value);
    return arrived.error;
}

Error Attempt::head_for(const sf_vec3& feet, const sf_vec3& waypoint) {
    const Error error = error_of(sf_agents_set_goal, agents_->handle(), agent_, feet, waypoint);
    if (!error.is_set()) {
        waypoint_ = frame_.from_map(waypoint);
        is_at_waypoint_ = false;
    }
    return error;
}

Error Attempt::advance_straight(const sf_vec3& feet) {
    // Progress starts again whenever the goal moves, so a character that stands still gives up as well.
    standing_++;
    if (distance_on_map(feet, stood_at_) > SF_REACHED_WITHIN) {
        stood_at_ = feet;
        standing_ = 0;
    }
    sf_progress progress{};
    progress.struct_size = sizeof progress;
    const Error error = error_of(sf_agents_progress, static_cast<const sf_agents*>(agents_->handle()), agent_, &progress);
    return error.is_set() || std::max(progress.stalled_decisions, standing_) < hopeless_after ? error : end(AttemptState::GaveUp);
}

Error Attempt::follow(const Character& character) {
    const sf_vec3 feet = frame_.to_map(character.feet);
    sf_step step{};
    step.struct_size = sizeof step;
    Error error = error_of(sf_follower_advance, follower_.get(), feet, std::int32_t(is_at_waypoint_), &step);
    if (needs_plan_ && (step.kind == SF_STEP_KEEP || step.kind == SF_STEP_HEAD)) {
        step.kind = SF_STEP_PLAN;
    }
    needs_plan_ = needs_plan_ && error.is_set();
    error = error.is_set() ? error : take(step, feet);
    const sf_state now = state_of(character, frame_);
    const sf_state* state = &now;
    while (!error.is_set() && rehearsals_ != nullptr && state_ == AttemptState::GoesOn) {
        error = error_of(sf_follower_prepare, follower_.get(), rehearsals_->handle(), agents_->handle(), agent_, state, sf_vec3{}, &step);
        if (error.is_set() || step.kind == SF_STEP_KEEP) {
            break;
        }
        error = take(step, feet);
    }
    stands_ = step.stands != 0;
    return error;
}

Error Attempt::take(sf_step& step, const sf_vec3& feet) {
    if (step.kind == SF_STEP_PLAN) {
        const Error error = error_of(sf_follower_plan, follower_.get(), static_cast<const sf_graph*>(graph_->handle()), feet, caution_, std::uint32_t(0), &step);
        if (error.is_set()) {
            return error;
        }
    }
    switch (step.kind) {
    case SF_STEP_HEAD: return head_for(feet, step.waypoint);
    case SF_STEP_GIVE_UP: return end(AttemptState::GaveUp);
    case SF_STEP_UNREACHABLE: return end(AttemptState::Unreachable);
    default: return {};
    }
}

Error Attempt::end(AttemptState state) {
    state_ = state;
    if (!follower_) {
        return {};
    }
    std::vector<sf_traversal> traversals;
    std::size_t count = 0;
    const auto take = [&](sf_error* error) {
        return sf_follower_take_traversals(follower_.get(), traversals.data(), traversals.size(), &count, error);
    };
    if (take(nullptr) == SF_BUFFER_TOO_SMALL) {
        traversals.resize(count);
    }
    const Error error = error_of(take);
    return error.is_set() ? error
                          : error_of(sf_graph_note_traversals, graph_->handle(), static_cast<const sf_traversal*>(traversals.data()), count);
}

}  // namespace surefoot
