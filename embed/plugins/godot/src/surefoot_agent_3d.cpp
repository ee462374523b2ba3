#include "surefoot_agent_3d_life.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace surefoot {

using engine::Array;
using engine::Dictionary;
using engine::push_error;
using engine::Variant;

namespace {

constexpr double decisions_per_second = 6.0;
// An attempt without a plan is hopeless after as many decisions without coming closer.
constexpr uint32_t hopeless_decisions = 300;
// A waypoint within 1 cm of the goal is the goal: places are rounded on their way to the map and back.
constexpr float same_m = 0.01f;
// How much farther than its radius a target gets away until the character follows again, m.
constexpr double keep_slack_m = 0.5;

// Physics ticks from one decision to the next, whatever the project's tick rate.
int64_t ticks_per_decision() {
    const double ticks_per_second = static_cast<double>(Variant::singleton("Engine").call("get_physics_ticks_per_second").integer());
    return std::max<int64_t>(1, std::llround(ticks_per_second / decisions_per_second));
}

}  // namespace

// ---------------------------------------------------------------------------------------------------------------- beginning and end

SurefootAgent3D::SurefootAgent3D() { sf_body_default(&profile_, nullptr); }

SurefootAgent3D::~SurefootAgent3D() = default;

void SurefootAgent3D::notified(int32_t what) {
    if (what == engine::NOTIFICATION_READY) {
        begin();
    } else if (what == engine::NOTIFICATION_EXIT_TREE) {
        end();
        // Another parent may give another body.
        self().call("request_ready");
    } else if (what == engine::NOTIFICATION_INTERNAL_PHYSICS_PROCESS && life_ != nullptr) {
        tick();
    }
}

void SurefootAgent3D::begin() {
    const Variant body = self().call("get_parent");
    double feet_offset = 0.0;
    if (body.object() == nullptr || !body.call("is_class", "CharacterBody3D").boolean()) {
        push_error("SurefootAgent3D: its parent is no CharacterBody3D: make it a child of the character that it is to move");
        return;
    }
    if (!read_body(body, feet_offset)) {
        return;
    }
    sf_policy* policy = nullptr;
    sf_agents* agents = make_agents(policy);
    if (agents == nullptr) {
        sf_policy_destroy(policy);
        return;
    }
    life_ = std::make_unique<Life>(body, profile_, policy, agents, feet_offset);
    life_->sight.set_mask(ray_mask_);
    life_->sight.set_sees_areas(sees_areas_);
    const std::vector<sf_device> devices = find_devices(self());
    sf_error error;
    if (!devices.empty()) {
        succeeded(sf_agents_set_devices(agents, devices.data(), devices.size(), &error), error);
    }
    respawned();
    self().call("set_physics_process_internal", true);
}

void SurefootAgent3D::end() {
    is_navigating_ = false;
    target_id_ = 0;
    action_ = {};
    life_.reset();
}

// Reads the size of the capsule and the walkable slopes from the character.
bool SurefootAgent3D::read_body(const Variant& body, double& feet_offset) {
    const int64_t child_count = body.call("get_child_count").integer();
    for (int64_t idx = 0; idx < child_count; idx++) {
        const Variant child = body.call("get_child", idx);
        const Variant shape = child.call("is_class", "CollisionShape3D").boolean() ? child.call("get_shape") : Variant();
        if (shape.object() == nullptr || !shape.call("is_class", "CapsuleShape3D").boolean()) {
            continue;
        }
        profile_.height = static_cast<float>(shape.call("get_height").number());
        profile_.radius = static_cast<float>(shape.call("get_radius").number());
        profile_.max_slope = static_cast<float>(body.call("get_floor_max_angle").number());
        profile_.uses_zip_lines = (without_ & SF_ZIP_LINE_BIT) == 0;
        profile_.uses_jetpacks = (without_ & SF_JETPACK_BIT) == 0;
        profile_.climb_speed = (without_ & SF_CLIMB_BIT) == 0 ? profile_.climb_speed : 0.0f;
        feet_offset = profile_.height / 2.0 - static_cast<double>(child.call("get_position").vector3().y);
        return true;
    }
    push_error("SurefootAgent3D: its parent has no CollisionShape3D with a CapsuleShape3D: give the character one");
    return false;
}

sf_agents* SurefootAgent3D::make_agents(sf_policy*& policy) {
    sf_error error;
    sf_agents* agents = nullptr;
    const bool is_folder = policy_.find('/') != std::string::npos;
    if (is_folder) {
        std::vector<uint8_t> manifest, weights;
        if (!read_file("SurefootAgent3D.policy", policy_ + "/manifest.json", manifest) ||
            !read_file("SurefootAgent3D.policy", policy_ + "/weights.bpk", weights) ||
            !succeeded(sf_policy_load_memory(manifest.data(), manifest.size(), weights.data(), weights.size(), &policy, &error), error)) {
            return nullptr;
        }
    } else if (!succeeded(sf_policy_shipped(policy_.c_str(), &policy, &error), error)) {
        return nullptr;
    }
    succeeded(sf_agents_create(policy, &profile_, 1, &agents, &error), error);
    return agents;
}

void SurefootAgent3D::set_graph(const Variant& graph) {
    if (graph.object() != nullptr && dynamic_cast<SurefootGraph*>(engine::Instance::of(graph)) == nullptr) {
        push_error("SurefootAgent3D.graph is another kind of object: set it to a SurefootGraph");
        return;
    }
    graph_ = graph;
}

// ---------------------------------------------------------------------------------------------------------------- ticks and decisions

sf_vec3 SurefootAgent3D::feet() const {
    sf_vec3 place = life_->body.call("get_global_position").vector3();
    place.y -= static_cast<float>(life_->feet_offset);
    return place;
}

void SurefootAgent3D::tick() {
    // A receiver of a signal may remove the agent from the scene.
    if (is_navigating_ && !note()) {
        return;
    }
    if (++life_->tick % ticks_per_decision() == 0) {
        chase();
        if (life_ == nullptr || (is_navigating_ && !decide())) {
            return;
        }
    }
    if (life_ == nullptr) {
        return;
    }
    if (moves_body_) {
        life_->walker.move(static_cast<float>(self().call("get_physics_process_delta_time").number()));
    }
    follow_motion();
}

// Notes what the character passes, and whether it has arrived. False if the agent has left the scene.
bool SurefootAgent3D::note() {
    const sf_state now = state();
    int32_t passed = 0;
    sf_error error;
    if (!succeeded(sf_agents_note(life_->agents, 0, now.feet, &passed, &error), error)) {
        fail("error");
        return life_ != nullptr;
    }
    // Waypoints are passed on the run or in flight, but at some the character stands. If that is the goal itself, the
    // follower counts the time until the character has arrived there.
    const bool is_goal = distance(waypoint_, goal_) <= same_m;
    life_->waypoint_was_reached |=
        life_->stands ? !is_goal && has_arrived(now, waypoint_, SF_REACHED_WITHIN) : passed != 0;
    if (has_arrived(now, goal_, goal_radius_)) {
        arrive();
    }
    return life_ != nullptr;
}

// Whether the character stands near a place of the scene, with nothing solid between.
bool SurefootAgent3D::has_arrived(const sf_state& state, sf_vec3 goal, double radius) {
    const float within = static_cast<float>(radius);
    sf_ray rays[SF_ARRIVAL_RAY_COUNT];
    sf_hit hits[SF_ARRIVAL_RAY_COUNT];
    size_t ray_count = 0;
    int32_t arrived = 0;
    sf_error error;
    if (!succeeded(sf_agents_arrival_rays(life_->agents, &state, goal, within, rays, SF_ARRIVAL_RAY_COUNT, &ray_count,
                                          &error), error) || ray_count == 0) {
        return false;
    }
    life_->sight.cast(rays, ray_count, hits);
    return succeeded(sf_agents_has_arrived(life_->agents, &state, goal, within, hits, &arrived, &error), error) &&
           arrived != 0;
}

// Before a decision: moves the goal to the node that is followed.
void SurefootAgent3D::chase() {
    if (target_id_ == 0) {
        return;
    }
    const Variant target = get_target();
    if (target.is_nil() || !target.call("is_inside_tree").boolean()) {
        fail("target_lost");
        return;
    }
    const sf_vec3 place = target.call("get_global_position").vector3();
    const bool has_got_away = static_cast<double>(distance(place, feet())) > goal_radius_ + keep_slack_m;
    if ((is_navigating_ || has_got_away) && !go_to(place)) {
        fail("error");
    }
}

sf_state SurefootAgent3D::state() const {
    const bool can_air_jump = moves_body_ ? life_->walker.can_jump() : can_air_jump_;
    sf_state state{};
    state.struct_size = sizeof state;
    state.flags = life_->body.call("is_on_floor").boolean() ? SF_GROUNDED : can_air_jump ? SF_CAN_JUMP : 0;
    state.feet = feet();
    state.velocity = life_->body.call("get_velocity").vector3();
    state.yaw = frames::yaw_of(life_->body.call("get_global_rotation").vector3().y);
    return state;
}

// Observes and decides. False if the attempt has ended instead.
bool SurefootAgent3D::decide() {
    if (!choose_waypoint()) {
        return false;
    }
    const sf_state seen_from = state();
    const auto cast = [](void* sight, const sf_ray* rays, size_t ray_count, sf_hit* hits) {
        static_cast<Sight*>(sight)->cast(rays, ray_count, hits);
    };
    sf_error error;
    if (!succeeded(sf_agents_observe_with(life_->agents, nullptr, &seen_from, 1, cast, &life_->sight, &error), error) ||
        !succeeded(sf_agents_decide(life_->agents, nullptr, 1, static_cast<float>(noise_), &action_, &error), error)) {
        fail("error");
        return false;
    }
    life_->walker.begin_decision(action_);
    self().call("emit_signal", "decided");
    return life_ != nullptr;
}

// False if the attempt has ended.
bool SurefootAgent3D::choose_waypoint() {
    if (SurefootGraph* plans = graph(); plans != nullptr && life_->follower != nullptr) {
        return follow_plan(*plans);
    }
    sf_progress progress{};
    progress.struct_size = sizeof progress;
    sf_error error;
    if (!succeeded(sf_agents_progress(life_->agents, 0, &progress, &error), error)) {
        fail("error");
        return false;
    }
    // Progress starts again whenever the goal moves, so a character that stands still gives up as well.
    life_->standing++;
    if (distance(feet(), life_->stood_at) > SF_REACHED_WITHIN) {
        life_->stood_at = feet();
        life_->standing = 0;
    }
    if (std::max(progress.stalled_decisions, life_->standing) >= hopeless_decisions) {
        fail("no_progress");
        return false;
    }
    return true;
}

bool SurefootAgent3D::follow_plan(SurefootGraph& plans) {
    sf_step step{};
    step.struct_size = sizeof step;
    sf_error error;
    bool is_sound = succeeded(sf_follower_advance(life_->follower, plans.to_map(feet()), life_->waypoint_was_reached, &step, &error), error);
    life_->waypoint_was_reached = false;
    const auto goes_on = [&] { return is_sound && step.kind != SF_STEP_GIVE_UP && step.kind != SF_STEP_UNREACHABLE; };
    if (goes_on() && std::exchange(life_->needs_plan, false)) {
        step.kind = SF_STEP_PLAN;
    }
    is_sound = is_sound && take_step(plans, step);
    sf_rehearsals* rehearsals = goes_on() ? plans.rehearsals_of(life_->policy, profile_) : nullptr;
    const sf_state now = state();
    for (bool is_prepared = false; rehearsals != nullptr && goes_on() && !is_prepared;) {
        is_sound = succeeded(sf_follower_prepare(life_->follower, rehearsals, life_->agents, 0, &now, plans.get_origin(), &step, &error), error);
        is_prepared = step.kind == SF_STEP_KEEP;
        is_sound = is_sound && take_step(plans, step);
    }
    life_->stands = step.stands != 0;
    if (!goes_on()) {
        fail(!is_sound ? "error" : step.kind == SF_STEP_GIVE_UP ? "gave_up" : "unreachable");
        return false;
    }
    if (step.plans != life_->plans) {
        life_->plans = step.plans;
        self().call("emit_signal", "plan_changed");
    }
    return is_navigating_;
}

// Does what a step says, which may be to take another plan, with a step of its own. False if a call fails.
bool SurefootAgent3D::take_step(SurefootGraph& plans, sf_step& step) {
    sf_error error;
    if (step.kind == SF_STEP_PLAN &&
        (plans.loaded() == nullptr || !succeeded(sf_follower_plan(life_->follower, plans.loaded(), plans.to_map(feet()), static_cast<float>(caution_),
                                                                  static_cast<uint32_t>(without_), &step, &error), error))) {
        return false;
    }
    return step.kind != SF_STEP_HEAD || head_for(plans.from_map(step.waypoint));
}

bool SurefootAgent3D::head_for(sf_vec3 waypoint) {
    sf_error error;
    if (!succeeded(sf_agents_set_goal(life_->agents, 0, feet(), waypoint, &error), error)) {
        return false;
    }
    waypoint_ = waypoint;
    life_->waypoint_was_reached = false;
    return true;
}

Array SurefootAgent3D::get_plan() {
    Array plan;
    SurefootGraph* plans = graph();
    if (life_ == nullptr || life_->follower == nullptr || plans == nullptr) {
        return plan;
    }
    std::vector<sf_leg> legs(32);
    size_t count = 0;
    sf_error error;
    sf_status status = sf_follower_legs(life_->follower, legs.data(), legs.size(), &count, &error);
    if (status == SF_BUFFER_TOO_SMALL) {
        legs.resize(count);
        status = sf_follower_legs(life_->follower, legs.data(), legs.size(), &count, &error);
    }
    legs.resize(succeeded(status, error) ? count : 0);
    for (const sf_leg& leg : legs) {
        plan.call("append", plans->describe(leg));
    }
    return plan;
}

Dictionary SurefootAgent3D::get_action() const {
    Dictionary action;
    action.set("forward", static_cast<double>(action_.forward));
    action.set("strafe", static_cast<double>(action_.strafe));
    action.set("turn", static_cast<double>(action_.turn));
    action.set("jump", static_cast<double>(action_.jump));
    return action;
}

}  // namespace surefoot
