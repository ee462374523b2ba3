// How attempts of SurefootAgent3D begin, move and end.
#include "surefoot_agent_3d_life.hpp"

#include <algorithm>

namespace surefoot {

using engine::push_error;
using engine::Variant;

namespace {

// How far a place is from the goal at most to be near it: in m, and as a share of the character's distance from the
// goal.
constexpr float near_m = 4.0f;
constexpr float near_share = 0.25f;

}  // namespace

bool SurefootAgent3D::set_goal(sf_vec3 goal) {
    if (life_ == nullptr) {
        push_error("SurefootAgent3D.set_goal: the agent is not ready: add it to the scene as a child of a CharacterBody3D, and see earlier errors");
        return false;
    }
    target_id_ = 0;
    return go_to(goal);
}

bool SurefootAgent3D::follow(const Variant& target) {
    if (target.object() == nullptr || !target.call("is_class", "Node3D").boolean()) {
        push_error("SurefootAgent3D.follow: the target is no Node3D: pass the node that the agent is to follow");
        return false;
    }
    if (!set_goal(target.call("get_global_position").vector3())) {
        return false;
    }
    target_id_ = target.call("get_instance_id").integer();
    return true;
}

Variant SurefootAgent3D::get_target() const { return target_id_ == 0 ? Variant() : Variant::object_with(target_id_); }

void SurefootAgent3D::set_goal_radius(double radius) {
    if (!(radius >= 0.0 && radius <= static_cast<double>(SF_RAY_RANGE))) {
        push_error("SurefootAgent3D.goal_radius is out of range: set it to 0 to 30 m");
        return;
    }
    goal_radius_ = radius;
}

bool SurefootAgent3D::go_to(sf_vec3 goal) { return is_near_goal(goal) ? move_goal(goal) : begin_attempt(goal); }

bool SurefootAgent3D::is_near_goal(sf_vec3 place) const {
    // A new graph needs another attempt.
    const bool goes_on = is_navigating_ && life_->plans_of == graph();
    return goes_on && distance(place, goal_) <= std::max(near_m, near_share * distance(feet(), goal_));
}

bool SurefootAgent3D::begin_attempt(sf_vec3 goal) {
    halt();
    sf_error error;
    SurefootGraph* plans = graph();
    life_->plans_of = plans;
    life_->stood_at = feet();
    life_->standing = 0;
    if (plans != nullptr &&
        (plans->loaded() == nullptr || !succeeded(sf_follower_create(plans->to_map(goal), &life_->follower, &error), error))) {
        return false;
    }
    goal_ = goal;
    // With a plan this holds until the next decision, which knows the first waypoint.
    is_navigating_ = head_for(goal);
    return is_navigating_;
}

// The attempt goes on with another goal, and takes another plan once the goal has drifted far.
bool SurefootAgent3D::move_goal(sf_vec3 goal) {
    sf_error error;
    SurefootGraph* plans = graph();
    if (life_->follower == nullptr || plans == nullptr) {
        const bool is_set = distance(goal, goal_) == 0.0f || head_for(goal);
        goal_ = is_set ? goal : goal_;
        return is_set;
    }
    sf_step step{};
    step.struct_size = sizeof step;
    if (!succeeded(sf_follower_move_goal(life_->follower, plans->to_map(goal), plans->to_map(feet()),
                                         life_->waypoint_was_reached, &step, &error), error)) {
        return false;
    }
    goal_ = goal;
    life_->needs_plan = step.kind == SF_STEP_PLAN;
    return step.kind != SF_STEP_HEAD || head_for(plans->from_map(step.waypoint));
}

void SurefootAgent3D::stop() {
    target_id_ = 0;
    halt();
}

// Ends the attempt; a node that is followed stays.
void SurefootAgent3D::halt() {
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
    halt();
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
    life_->waypoint_was_reached = life_->stands = life_->needs_plan = false;
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

}  // namespace surefoot
