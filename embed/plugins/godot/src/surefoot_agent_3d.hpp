// The node SurefootAgent3D: the mind of the CharacterBody3D that is its parent, and, unless told otherwise, its legs.
#pragma once

#include "engine.hpp"
#include "sight.hpp"
#include "surefoot_graph.hpp"
#include "walker.hpp"

#include <memory>

namespace surefoot {

class SurefootAgent3D final : public engine::Instance {
public:
    static void register_class();
    SurefootAgent3D();
    ~SurefootAgent3D() override;
    void notified(int32_t what) override;

    // Heads for a place of the scene. Near the present goal, the attempt goes on with the new one, so a target that
    // moves may be passed in every tick. False, and an error in the log, if the agent cannot.
    bool set_goal(sf_vec3 goal);
    // Goes to a Node3D and follows it, also after it was reached, until another goal is set or an attempt fails.
    bool follow(const engine::Variant& target);
    // Gives up the goal without a signal.
    void stop();
    // Call this when the character has died or was moved elsewhere: the agent forgets what it remembers, and fails if it had a goal.
    void respawned();
    bool is_navigating() const { return is_navigating_; }
    sf_vec3 get_goal() const { return goal_; }
    // The node that is followed; nil without one.
    engine::Variant get_target() const;
    // Where the agent heads for now: the end of a leg, or the goal.
    sf_vec3 get_waypoint() const { return waypoint_; }
    // Legs of the plan; empty without one.
    engine::Array get_plan();
    // For characters with controllers of their own: forward, strafe, turn and jump, -1 to 1.
    engine::Dictionary get_action() const;
    // How the character moves, for its animation.
    engine::Dictionary get_locomotion() const;
    // Says that the character has just used an ability: by a device, or by a controller of its own.
    void note_ability(const std::string& ability);

    engine::Variant get_graph() const { return graph_; }
    void set_graph(const engine::Variant& graph);
    std::string get_policy() const { return policy_; }
    void set_policy(const std::string& policy) { policy_ = policy; }
    bool get_moves_body() const { return moves_body_; }
    void set_moves_body(bool moves_body) { moves_body_ = moves_body; }
    // For characters with controllers of their own, which alone know it: whether a jump in the air would be made now.
    bool get_can_air_jump() const { return can_air_jump_; }
    void set_can_air_jump(bool can_air_jump) { can_air_jump_ = can_air_jump; }
    // Distance from the goal within which the character must stand, m.
    double get_goal_radius() const { return goal_radius_; }
    void set_goal_radius(double radius);
    double get_noise() const { return noise_; }
    void set_noise(double noise) { noise_ = noise; }
    int64_t get_noise_seed() const { return noise_seed_; }
    void set_noise_seed(int64_t seed) { noise_seed_ = seed; }
    double get_caution() const { return caution_; }
    void set_caution(double caution) { caution_ = caution; }
    int64_t get_without() const { return without_; }
    void set_without(int64_t without) { without_ = without; }
    int64_t get_ray_mask() const { return ray_mask_; }
    void set_ray_mask(int64_t mask) { ray_mask_ = mask; }
    bool get_sees_areas() const { return sees_areas_; }
    void set_sees_areas(bool sees_areas) { sees_areas_ = sees_areas; }
    // Values of the body that Godot's character does not have itself.
    template <float sf_body::*field>
    double get_value() const {
        return static_cast<double>(profile_.*field);
    }
    template <float sf_body::*field>
    void set_value(double value) {
        profile_.*field = static_cast<float>(value);
    }
    int64_t get_extra_jumps() const { return profile_.extra_jumps; }
    void set_extra_jumps(int64_t jumps) { profile_.extra_jumps = static_cast<uint32_t>(jumps); }

    // For SurefootGameServer. From now on it moves the character, and the scene's physics ticks no longer do. False if
    // the agent is not ready.
    bool be_driven();
    // Puts the character there, at rest, m and rad.
    void place(sf_vec3 feet, float yaw);
    void act(const sf_action& action);
    // Moves the character. Returns the ability that it used.
    sf_ability step(float seconds);
    sf_vec3 feet() const;
    sf_state state() const;
    void cast(const sf_ray* rays, size_t ray_count, sf_hit* hits);
    // Whether the character touched a collider of this group in its last move.
    bool touches(const char* group) const;
    const sf_body& profile() const { return profile_; }

private:
    // What the agent has while it is in a scene.
    struct Life;

    static void register_properties(engine::ClassBuilder& builder);
    void begin();
    void end();
    bool read_body(const engine::Variant& body, double& feet_offset);
    sf_agents* make_agents(sf_policy*& policy);
    SurefootGraph* graph() const { return dynamic_cast<SurefootGraph*>(engine::Instance::of(graph_)); }

    void tick();
    bool note();
    bool has_arrived(const sf_state& state, sf_vec3 goal, double radius);
    void chase();
    bool decide();
    void follow_motion();
    bool go_to(sf_vec3 goal);
    bool is_near_goal(sf_vec3 place) const;
    bool begin_attempt(sf_vec3 goal);
    bool move_goal(sf_vec3 goal);
    bool choose_waypoint();
    bool follow_plan(SurefootGraph& plans);
    bool take_step(SurefootGraph& plans, sf_step& step);
    void halt();
    bool head_for(sf_vec3 waypoint);
    void arrive();
    void fail(const std::string& reason);
    void close_attempt();
    void note_traversals(SurefootGraph& graph);

    std::unique_ptr<Life> life_;
    sf_body profile_{};
    engine::Variant graph_;
    std::string policy_ = "general-reactive";
    bool moves_body_ = true;
    bool can_air_jump_ = false;
    double noise_ = SF_DEFAULT_NOISE;
    int64_t noise_seed_ = 0;
    double caution_ = 1.0;
    int64_t without_ = SF_ZIP_LINE_BIT | SF_JETPACK_BIT | SF_CLIMB_BIT;
    int64_t ray_mask_ = 1;
    bool sees_areas_ = false;
    double goal_radius_ = SF_REACHED_WITHIN;

    // The id of the node that is followed; 0 without one.
    int64_t target_id_ = 0;
    bool is_navigating_ = false;
    sf_vec3 goal_{};
    sf_vec3 waypoint_{};
    sf_action action_{};
};

}  // namespace surefoot
