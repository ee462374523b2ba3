#include "walker.hpp"

#include "frames.hpp"

#include <algorithm>
#include <utility>

namespace surefoot {

using engine::Variant;

namespace {

// Terminal speed of a fall, m/s.
constexpr float max_fall_speed = 45.0f;
// Upward speed from which a body on the floor was thrown, by a jump pad for instance, m/s: walking leaves none.
constexpr float thrown_speed = 1.0f;

}  // namespace

Walker::Walker(const Variant& body, const sf_body& profile) : body_(body), profile_(profile) {
    // A body that runs down a slope, or off a step, stays on the ground.
    const float fall_in_a_tick = profile.forward_speed / SF_TICKS_PER_SECOND * std::tan(profile.max_slope);
    body_.call("set_floor_snap_length", static_cast<double>(profile.step_height + fall_in_a_tick));
    // A body that touches a steep face slides along it. By default, Godot's characters stop there and cannot climb
    // rough slopes.
    body_.call("set_floor_block_on_wall_enabled", false);
}

void Walker::begin_decision(const sf_action& action) {
    action_ = action;
    jump_is_pending_ = action.jump > 0.0f;
}

bool Walker::can_jump() const { return is_on_floor_ || ticks_in_air_ <= profile_.coyote_ticks || air_jumps_left_ > 0; }

sf_ability Walker::take_jump() { return std::exchange(jump_, SF_WALK); }

sf_vec3 Walker::wish(float yaw) const {
    const float sin = std::sin(yaw), cos = std::cos(yaw);
    const float forward = std::max(action_.forward, -profile_.side_speed_share), right = action_.strafe * profile_.side_speed_share;
    sf_vec3 wish{sin * forward - cos * right, 0.0f, cos * forward + sin * right};
    const float scale = profile_.forward_speed / std::max(1.0f, frames::length(wish));
    return {wish.x * scale, 0.0f, wish.z * scale};
}

void Walker::accelerate(sf_vec3& velocity, sf_vec3 wish, float seconds) const {
    const float limit = (is_on_floor_ ? profile_.ground_acceleration : profile_.air_acceleration) * seconds;
    const sf_vec3 change{wish.x - velocity.x, 0.0f, wish.z - velocity.z};
    const float share = std::min(1.0f, limit / std::max(frames::length(change), 1.0e-6f));
    velocity.x += change.x * share;
    velocity.z += change.z * share;
    velocity.y = std::max(velocity.y - profile_.gravity * seconds, -max_fall_speed);
}

void Walker::leave_floor() {
    // Past the ticks in which a jump still counts as one from the ground.
    ticks_in_air_ = profile_.coyote_ticks + 1;
    is_on_floor_ = false;
}

void Walker::jump(sf_vec3& velocity) {
    if (!jump_is_pending_ || !can_jump()) {
        return;
    }
    const bool is_in_air = !is_on_floor_ && ticks_in_air_ > profile_.coyote_ticks;
    if (is_in_air) {
        air_jumps_left_--;
    }
    jump_ = is_in_air ? SF_DOUBLE_JUMP : SF_JUMP;
    velocity.y = profile_.jump_speed;
    leave_floor();
    jump_is_pending_ = false;
}

// Lifts the body over a step in front of it. Godot's own motion stops at edges that are higher than the roundness of a
// capsule.
void Walker::climb_step(sf_vec3 velocity, float seconds) const {
    if (!is_on_floor_ || profile_.step_height <= 0.0f || !body_.call("is_on_wall").boolean()) {
        return;
    }
    const sf_vec3 up{0.0f, profile_.step_height, 0.0f}, ahead{velocity.x * seconds, 0.0f, velocity.z * seconds};
    const Variant here = body_.call("get_global_transform");
    const Variant above = here.call("translated", up);
    const bool is_step = body_.call("test_move", here, ahead).boolean() && !body_.call("test_move", here, up).boolean() &&
                         !body_.call("test_move", above, ahead).boolean();
    if (is_step) {
        body_.call("set_global_transform", above);
    }
}

void Walker::move(float seconds) {
    body_.call("rotate_y", static_cast<double>(action_.turn * profile_.turn_speed * seconds));
    sf_vec3 velocity = body_.call("get_velocity").vector3();
    if (is_on_floor_ && velocity.y > thrown_speed) {
        leave_floor();
    }
    accelerate(velocity, wish(frames::yaw_of(body_.call("get_global_rotation").vector3().y)), seconds);
    jump(velocity);
    climb_step(velocity, seconds);
    body_.call("set_velocity", velocity);
    body_.call("move_and_slide");
    is_on_floor_ = body_.call("is_on_floor").boolean();
    if (is_on_floor_) {
        ticks_in_air_ = 0;
        air_jumps_left_ = profile_.extra_jumps;
    } else {
        ticks_in_air_ = std::min<uint32_t>(ticks_in_air_ + 1, 255);
    }
}

}  // namespace surefoot
