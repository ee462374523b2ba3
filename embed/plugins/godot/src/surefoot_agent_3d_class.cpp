// How scripts and the inspector see SurefootAgent3D.
#include "surefoot_agent_3d.hpp"

namespace surefoot {

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
        .method<&A::follow>("follow", {"target"})
        .method<&A::stop>("stop")
        .method<&A::respawned>("respawned")
        .method<&A::is_navigating>("is_navigating")
        .method<&A::get_goal>("get_goal")
        .method<&A::get_target>("get_target")
        .method<&A::get_waypoint>("get_waypoint")
        .method<&A::get_plan>("get_plan")
        .method<&A::get_action>("get_action")
        .method<&A::get_locomotion>("get_locomotion")
        .method<&A::note_ability>("note_ability", {"ability"})
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
        .property<&A::get_goal_radius, &A::set_goal_radius>(value("goal_radius", "0.1,10,0.1,suffix:m"))
        .property<&A::get_noise, &A::set_noise>(value("noise", "0,1,0.05"))
        .property<&A::get_noise_seed, &A::set_noise_seed>({"noise_seed", integer, 0, "", ""})
        .group("Plans")
        .property<&A::get_caution, &A::set_caution>(value("caution", "0,1,0.05"))
        .property<&A::get_without, &A::set_without>(
            {"without", integer, hint_flags, "Jump:2,Double jump:4,Pad:8,Zip line:16,Teleporter:32,Jetpack:64,Climb:128,Mantle:256,Swim:512,"
             "Crouch:1024,Dash:2048,Wall run:4096,Slide:8192,Dive:16384", ""})
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
