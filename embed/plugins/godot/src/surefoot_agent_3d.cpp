#include "surefoot_agent_3d.hpp"

#include "frames.hpp"

#include <algorithm>
#include <cmath>

namespace surefoot {

using engine::Array;
using engine::Dictionary;
using engine::push_error;
using engine::Variant;

namespace {

constexpr double decisions_per_second = 6.0;
// An attempt without a plan is hopeless after as many decisions without coming closer.
constexpr uint32_t hopeless_decisions = 300;

// Agents begin in different ticks, so that each tick has its share of the decisions.
int64_t next_phase() {
    static int64_t agent_count = 0;
    return agent_count++;
}

// Reports what a call of an agent says. True if it succeeded.
bool succeeded(sf_status status, const sf_error& error) {
    if (status != SF_OK) {
        push_error(std::string("SurefootAgent3D: ") + error.message);
    }
    return status == SF_OK;
}

// Physics ticks from one decision to the next, whatever the project's tick rate.
int64_t ticks_per_decision() {
    const double ticks_per_second = static_cast<double>(Variant::singleton("Engine").call("get_physics_ticks_per_second").integer());
    return std::max<int64_t>(1, std::llround(ticks_per_second / decisions_per_second));
}

}  // namespace

struct SurefootAgent3D::Life {
    Life(const Variant& body, const sf_body& profile, sf_agents* agents, double feet_offset)
        : body(body), sight(body), walker(body, profile), agents(agents), feet_offset(feet_offset) {}
    ~Life() {
        sf_follower_destroy(follower);
        sf_agents_destroy(agents);
    }
    Life(const Life&) = delete;
    Life& operator=(const Life&) = delete;

    Variant body;
    Sight sight;
    Walker walker;
    sf_agents* agents;
    // The attempt at the goal, if there is a graph.
    sf_follower* follower = nullptr;
    // Height of the body's origin above its feet, m.
    double feet_offset;
    int64_t tick = next_phase();
    bool waypoint_was_reached = false;
    uint32_t plans = 0;
};

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
    sf_agents* agents = make_agents();
    if (agents == nullptr) {
        return;
    }
    life_ = std::make_unique<Life>(body, profile_, agents, feet_offset);
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
        feet_offset = profile_.height / 2.0 - static_cast<double>(child.call("get_position").vector3().y);
        return true;
    }
    push_error("SurefootAgent3D: its parent has no CollisionShape3D with a CapsuleShape3D: give the character one");
    return false;
}

sf_agents* SurefootAgent3D::make_agents() {
    sf_error error;
    sf_policy* policy = nullptr;
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
    sf_policy_destroy(policy);
    return agents;
}

void SurefootAgent3D::set_graph(const Variant& graph) {
    if (graph.object() != nullptr && dynamic_cast<SurefootGraph*>(engine::Instance::of(graph)) == nullptr) {
        push_error("SurefootAgent3D.graph is another kind of object: set it to a SurefootGraph");
        return;
    }
    graph_ = graph;
}

// ---------------------------------------------------------------------------------------------------------------- attempts

bool SurefootAgent3D::set_goal(sf_vec3 goal) {
    if (life_ == nullptr) {
        push_error("SurefootAgent3D.set_goal: the agent is not ready: add it to the scene as a child of a CharacterBody3D, and see earlier errors");
        return false;
    }
    stop();
    sf_error error;
    SurefootGraph* plans = graph();
    if (plans != nullptr &&
        (plans->loaded() == nullptr || !succeeded(sf_follower_create(plans->to_map(goal), &life_->follower, &error), error))) {
        return false;
    }
    goal_ = goal;
    // With a plan this holds until the next decision, which knows the first waypoint.
    is_navigating_ = head_for(goal);
    return is_navigating_;
}

void SurefootAgent3D::stop() {
    is_navigating_ = false;
    action_ = {};
    if (life_ != nullptr) {
        life_->walker.begin_decision(action_);
        close_attempt();
    }
}

void SurefootAgent3D::respawned() {
    sf_error error;
    if (life_ == nullptr) {
        return;
    }
    if (life_->follower != nullptr) {
        sf_follower_note_death(life_->follower, nullptr);
    }
    if (is_navigating_) {
        fail("died");
    }
    const uint64_t seed = static_cast<uint64_t>(noise_seed_) + static_cast<uint64_t>(life_->tick);
    succeeded(sf_agents_begin(life_->agents, 0, seed, &error), error);
}

void SurefootAgent3D::arrive() {
    stop();
    self().call("emit_signal", "reached");
}

void SurefootAgent3D::fail(const std::string& reason) {
    stop();
    self().call("emit_signal", "failed", reason);
}

// Ends the attempt, and lets later plans know how its legs went.
void SurefootAgent3D::close_attempt() {
    if (life_->follower == nullptr) {
        return;
    }
    if (SurefootGraph* plans = graph()) {
        note_traversals(*plans);
    }
    sf_follower_destroy(life_->follower);
    life_->follower = nullptr;
    life_->plans = 0;
    life_->waypoint_was_reached = false;
}

void SurefootAgent3D::note_traversals(SurefootGraph& plans) {
    std::vector<sf_traversal> traversals(64);
    size_t count = 0;
    sf_error error;
    sf_status status = sf_follower_take_traversals(life_->follower, traversals.data(), traversals.size(), &count, &error);
    if (status == SF_BUFFER_TOO_SMALL) {
        traversals.resize(count);
        status = sf_follower_take_traversals(life_->follower, traversals.data(), traversals.size(), &count, &error);
    }
    if (succeeded(status, error) && plans.loaded() != nullptr) {
        succeeded(sf_graph_note_traversals(plans.loaded(), traversals.data(), count, &error), error);
    }
}

// ---------------------------------------------------------------------------------------------------------------- ticks and decisions

sf_vec3 SurefootAgent3D::feet() const {
    sf_vec3 place = life_->body.call("get_global_position").vector3();
    place.y -= static_cast<float>(life_->feet_offset);
    return place;
}

void SurefootAgent3D::tick() {
    if (is_navigating_) {
        const sf_vec3 place = feet();
        int32_t reached = 0;
        sf_error error;
        if (!succeeded(sf_agents_note(life_->agents, 0, place, &reached, &error), error)) {
            fail("error");
        } else if (frames::length(frames::minus(goal_, place)) <= SF_REACHED_WITHIN) {
            arrive();
        }
        const bool is_near = frames::length(frames::minus(waypoint_, place)) <= SF_REACHED_WITHIN;
        // A receiver of the signal may have removed the agent from the scene.
        if (life_ == nullptr) {
            return;
        }
        life_->waypoint_was_reached |= is_near;
    }
    if (++life_->tick % ticks_per_decision() == 0 && is_navigating_ && !decide()) {
        return;
    }
    if (life_ != nullptr && moves_body_) {
        life_->walker.move(static_cast<float>(self().call("get_physics_process_delta_time").number()));
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
    if (progress.stalled_decisions >= hopeless_decisions) {
        fail("no_progress");
        return false;
    }
    return true;
}

bool SurefootAgent3D::follow_plan(SurefootGraph& plans) {
    const sf_vec3 place = plans.to_map(feet());
    sf_step step{};
    step.struct_size = sizeof step;
    sf_error error;
    bool is_sound = succeeded(sf_follower_advance(life_->follower, place, life_->waypoint_was_reached, &step, &error), error);
    life_->waypoint_was_reached = false;
    if (is_sound && step.kind == SF_STEP_PLAN) {
        is_sound = plans.loaded() != nullptr && succeeded(sf_follower_plan(life_->follower, plans.loaded(), place, static_cast<float>(caution_),
                                                                          static_cast<uint32_t>(without_), &step, &error), error);
    }
    if (is_sound && step.kind == SF_STEP_HEAD) {
        is_sound = head_for(plans.from_map(step.waypoint));
    }
    if (!is_sound || step.kind == SF_STEP_GIVE_UP || step.kind == SF_STEP_UNREACHABLE) {
        fail(!is_sound ? "error" : step.kind == SF_STEP_GIVE_UP ? "gave_up" : "unreachable");
        return false;
    }
    if (step.plans != life_->plans) {
        life_->plans = step.plans;
        self().call("emit_signal", "plan_changed");
    }
    return is_navigating_;
}

bool SurefootAgent3D::head_for(sf_vec3 waypoint) {
    sf_error error;
    waypoint_ = waypoint;
    return succeeded(sf_agents_set_goal(life_->agents, 0, feet(), waypoint, &error), error);
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

// ---------------------------------------------------------------------------------------------------------------- registration

namespace {

constexpr engine::Type boolean = GDEXTENSION_VARIANT_TYPE_BOOL, integer = GDEXTENSION_VARIANT_TYPE_INT, number = GDEXTENSION_VARIANT_TYPE_FLOAT;
// Values of Godot's PropertyHint.
constexpr uint32_t hint_range = 1, hint_flags = 6, hint_layers = 11, hint_resource = 17;

engine::Property value(const char* name, const char* range) { return {name, number, hint_range, range, ""}; }

// A property of the body: the field of sf_body with its name.
template <float sf_body::*field>
void register_body(engine::ClassBuilder& builder, const char* name, const char* range) {
    builder.property<&SurefootAgent3D::get_value<field>, &SurefootAgent3D::set_value<field>>(value(name, range));
}

}  // namespace

void SurefootAgent3D::register_class() {
    using A = SurefootAgent3D;
    engine::ClassBuilder builder("SurefootAgent3D", "Node", true, []() -> std::unique_ptr<engine::Instance> { return std::make_unique<A>(); });
    builder.method<&A::set_goal>("set_goal", {"goal"})
        .method<&A::stop>("stop")
        .method<&A::respawned>("respawned")
        .method<&A::is_navigating>("is_navigating")
        .method<&A::get_goal>("get_goal")
        .method<&A::get_waypoint>("get_waypoint")
        .method<&A::get_plan>("get_plan")
        .method<&A::get_action>("get_action")
        .signal("reached")
        .signal("failed", {{"reason", GDEXTENSION_VARIANT_TYPE_STRING}})
        .signal("plan_changed")
        .signal("decided");
    register_properties(builder);
}

void SurefootAgent3D::register_properties(engine::ClassBuilder& builder) {
    using A = SurefootAgent3D;
    builder.property<&A::get_graph, &A::set_graph>({"graph", GDEXTENSION_VARIANT_TYPE_OBJECT, hint_resource, "SurefootGraph", "SurefootGraph"})
        .property<&A::get_policy, &A::set_policy>({"policy", GDEXTENSION_VARIANT_TYPE_STRING, 0, "", ""})
        .property<&A::get_moves_body, &A::set_moves_body>({"moves_body", boolean, 0, "", ""})
        .property<&A::get_can_air_jump, &A::set_can_air_jump>({"can_air_jump", boolean, 0, "", ""})
        .property<&A::get_noise, &A::set_noise>(value("noise", "0,1,0.05"))
        .property<&A::get_noise_seed, &A::set_noise_seed>({"noise_seed", integer, 0, "", ""})
        .group("Plans")
        .property<&A::get_caution, &A::set_caution>(value("caution", "0,1,0.05"))
        .property<&A::get_without, &A::set_without>(
            {"without", integer, hint_flags, "Jump:2,Double jump:4,Pad:8,Zip line:16,Teleporter:32,Jetpack:64", ""})
        .group("Rays")
        .property<&A::get_ray_mask, &A::set_ray_mask>({"ray_mask", integer, hint_layers, "", ""})
        .property<&A::get_sees_areas, &A::set_sees_areas>({"sees_areas", boolean, 0, "", ""})
        .group("Body")
        .property<&A::get_extra_jumps, &A::set_extra_jumps>({"extra_jumps", integer, hint_range, "0,255,1", ""});
    register_body<&sf_body::forward_speed>(builder, "forward_speed", "0.1,20,0.1,suffix:m/s");
    register_body<&sf_body::side_speed_share>(builder, "side_speed_share", "0,1,0.05");
    register_body<&sf_body::turn_speed>(builder, "turn_speed", "0.1,20,0.1,suffix:rad/s");
    register_body<&sf_body::jump_speed>(builder, "jump_speed", "0,30,0.1,suffix:m/s");
    register_body<&sf_body::gravity>(builder, "gravity", "1,100,0.1,suffix:m/s2");
    register_body<&sf_body::step_height>(builder, "step_height", "0,1,0.01,suffix:m");
    register_body<&sf_body::ground_acceleration>(builder, "ground_acceleration", "1,1000,1,suffix:m/s2");
    register_body<&sf_body::air_acceleration>(builder, "air_acceleration", "0,1000,1,suffix:m/s2");
}

}  // namespace surefoot
