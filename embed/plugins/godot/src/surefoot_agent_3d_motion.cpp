// How the character of SurefootAgent3D moves, for its animation.
#include "names.hpp"
#include "surefoot_agent_3d_life.hpp"

namespace surefoot {

using engine::Dictionary;

namespace {

// A tick may be shorter than 1/60 s by this share of it.
constexpr double rounding = 1.0e-6;

const char* name_of_pace(sf_pace pace) {
    switch (pace) {
        case SF_PACE_TURN: return "turn";
        case SF_PACE_WALK: return "walk";
        case SF_PACE_RUN: return "run";
        case SF_PACE_STOP: return "stop";
        default: return "idle";
    }
}

const char* name_of_phase(sf_move_phase phase) {
    switch (phase) {
        case SF_MOVE_FLIGHT: return "flight";
        case SF_MOVE_LANDING: return "landing";
        default: return "";
    }
}

}  // namespace

// Follows the character at the end of a physics tick. What is left of a tick of 1/60 s counts with the next one.
void SurefootAgent3D::follow_motion() {
    if (const sf_ability jumped = life_->walker.take_jump(); jumped != SF_WALK) {
        life_->used = jumped;
    }
    life_->motion_ticks += self().call("get_physics_process_delta_time").number() * SF_TICKS_PER_SECOND;
    const sf_state now = state();
    sf_error error;
    for (; life_->motion_ticks >= 1.0 - rounding; life_->motion_ticks -= 1.0) {
        succeeded(sf_locomotion_advance(&life_->motion, &profile_, &now, &action_, life_->used, &error), error);
        life_->used = SF_WALK;
    }
}

void SurefootAgent3D::note_ability(const std::string& ability) {
    const sf_ability used = ability_of(ability);
    if (used == SF_WALK) {
        engine::push_error("SurefootAgent3D.note_ability: there is no ability '" + ability +
                           "': it is jump, double_jump, pad, zip_line, teleporter, jetpack or climb");
    } else if (life_ != nullptr) {
        life_->used = used;
    }
}

Dictionary SurefootAgent3D::get_locomotion() const {
    const sf_locomotion motion = life_ == nullptr ? sf_locomotion{} : life_->motion;
    Dictionary described;
    described.set("pace", name_of_pace(motion.pace));
    described.set("phase", name_of_phase(motion.phase));
    described.set("ability", name_of(motion.ability).c_str());
    described.set("stride", static_cast<double>(motion.stride));
    described.set("stride_phase", static_cast<double>(motion.stride_phase));
    described.set("step_offset", static_cast<double>(motion.step_offset));
    return described;
}

}  // namespace surefoot
