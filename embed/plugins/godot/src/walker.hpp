// Moves a CharacterBody3D as bodies move where policies are trained: the same acceleration, air control, jumps and gravity, tick by tick.
#pragma once

#include "engine.hpp"

namespace surefoot {

class Walker {
public:
    Walker(const engine::Variant& body, const sf_body& profile);

    // Begins a decision: a positive `jump` asks for one jump, made at the first tick that allows one.
    void begin_decision(const sf_action& action);
    // One tick of `seconds`.
    void move(float seconds);
    // Whether the character can jump now.
    bool can_jump() const;
    // SF_JUMP or SF_DOUBLE_JUMP if the character has jumped since the last call, SF_WALK otherwise.
    sf_ability take_jump();

private:
    sf_vec3 wish(float yaw) const;
    void accelerate(sf_vec3& velocity, sf_vec3 wish, float seconds) const;
    void leave_floor();
    void jump(sf_vec3& velocity);
    void climb_step(sf_vec3 velocity, float seconds) const;

    engine::Variant body_;
    sf_body profile_;
    sf_action action_{};
    bool jump_is_pending_ = false;
    bool is_on_floor_ = false;
    uint32_t ticks_in_air_ = 0;
    uint32_t air_jumps_left_ = 0;
    sf_ability jump_ = SF_WALK;
};

}  // namespace surefoot
