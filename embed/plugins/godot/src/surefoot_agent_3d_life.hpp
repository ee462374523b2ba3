// What the parts of SurefootAgent3D share: what an agent has while it is in a scene.
#pragma once

#include "frames.hpp"
#include "surefoot_agent_3d.hpp"

namespace surefoot {

// Agents begin in different ticks, so that each tick has its share of the decisions.
inline int64_t next_phase() {
    static int64_t agent_count = 0;
    return agent_count++;
}

// Reports what a call of an agent says. True if it succeeded.
inline bool succeeded(sf_status status, const sf_error& error) {
    if (status != SF_OK) {
        engine::push_error(std::string("SurefootAgent3D: ") + error.message);
    }
    return status == SF_OK;
}

inline float distance(sf_vec3 a, sf_vec3 b) { return frames::length(frames::minus(a, b)); }

struct SurefootAgent3D::Life {
    Life(const engine::Variant& body, const sf_body& profile, sf_policy* policy, sf_agents* agents, double feet_offset)
        : body(body), sight(body), walker(body, profile), policy(policy), agents(agents), feet_offset(feet_offset) {
        motion.struct_size = sizeof motion;
    }
    ~Life() {
        sf_follower_destroy(follower);
        sf_agents_destroy(agents);
        sf_policy_destroy(policy);
    }
    Life(const Life&) = delete;
    Life& operator=(const Life&) = delete;

    engine::Variant body;
    Sight sight;
    Walker walker;
    sf_policy* policy;
    sf_agents* agents;
    // The attempt at the goal, if there is a graph.
    sf_follower* follower = nullptr;
    // The graph with which the attempt began, to be compared only.
    const SurefootGraph* plans_of = nullptr;
    // Height of the body's origin above its feet, m.
    double feet_offset;
    int64_t tick = next_phase();
    bool waypoint_was_reached = false;
    // Whether the character must stand at its waypoint.
    bool stands = false;
    // Whether the goal has drifted so far that another plan is needed.
    bool needs_plan = false;
    uint32_t plans = 0;
    // Where a character without a plan stood, and decisions since it was 1 m away from there.
    sf_vec3 stood_at{};
    uint32_t standing = 0;
    // How the character moves, ticks of 1/60 s since that was found, and an ability that it has used since then.
    sf_locomotion motion{};
    double motion_ticks = 0.0;
    sf_ability used = SF_WALK;
};

}  // namespace surefoot
