// What SurefootGameServer asks of an agent, instead of the scene's physics ticks.
#include "surefoot_agent_3d_life.hpp"

#include <utility>

namespace surefoot {

namespace {

// Upward speed from which a character that leaves the floor has jumped, m/s.
constexpr float jumped_speed = 1.0f;

}  // namespace

bool SurefootAgent3D::be_driven() {
    if (life_ == nullptr) {
        return false;
    }
    self().call("set_physics_process_internal", false);
    life_->body.call("set_physics_process", false);
    return true;
}

void SurefootAgent3D::place(sf_vec3 feet, float yaw) {
    feet.y += static_cast<float>(life_->feet_offset);
    life_->body.call("set_global_position", feet);
    life_->body.call("set_global_rotation", sf_vec3{0.0f, frames::rotation_of(yaw), 0.0f});
    life_->body.call("set_velocity", sf_vec3{});
    action_ = {};
    life_->walker = Walker(life_->body, profile_);
    life_->used = SF_WALK;
    // The character stands on the floor only after a move.
    step(1.0f / SF_TICKS_PER_SECOND);
}

void SurefootAgent3D::act(const sf_action& action) {
    action_ = action;
    life_->walker.begin_decision(action);
    self().call("emit_signal", "decided");
}

sf_ability SurefootAgent3D::step(float seconds) {
    if (moves_body_) {
        life_->walker.move(seconds);
        life_->used = life_->walker.take_jump();
    } else {
        const bool was_on_floor = life_->body.call("is_on_floor").boolean();
        life_->body.call("_physics_process", static_cast<double>(seconds));
        const bool has_left = was_on_floor && !life_->body.call("is_on_floor").boolean();
        if (life_->used == SF_WALK && has_left && life_->body.call("get_velocity").vector3().y > jumped_speed) {
            life_->used = SF_JUMP;
        }
    }
    return std::exchange(life_->used, SF_WALK);
}

void SurefootAgent3D::cast(const sf_ray* rays, size_t ray_count, sf_hit* hits) { life_->sight.cast(rays, ray_count, hits); }

bool SurefootAgent3D::touches(const char* group) const {
    const int64_t touched = life_->body.call("get_slide_collision_count").integer();
    for (int64_t idx = 0; idx < touched; idx++) {
        const engine::Variant collider = life_->body.call("get_slide_collision", idx).call("get_collider");
        if (collider.object() != nullptr && collider.call("is_in_group", group).boolean()) {
            return true;
        }
    }
    return false;
}

}  // namespace surefoot
