// What an agent sees of the scene: its rays in Godot's physics, and the devices of the level.
//
// Groups say what a node is: a collider in `surefoot_water` is water to rays, and so on; a node in no group is solid ground.
#pragma once

#include "engine.hpp"

namespace surefoot {

class Sight {
public:
    // `body` is the character that sees, which its own rays pass through.
    explicit Sight(const engine::Variant& body);

    void set_mask(int64_t mask);
    void set_sees_areas(bool sees_areas);

    // Casts the rays of one decision. To be called while physics is processed, when Godot lets its space be queried.
    void cast(const sf_ray* rays, size_t ray_count, sf_hit* hits);

private:
    sf_hit cast_one(const sf_ray& ray);
    sf_surface surface_of(const engine::Variant& collider);
    void pass_through(const engine::Variant& rid);

    engine::Variant body_;
    engine::Variant query_;
    // RIDs that rays pass through: the body itself, and other characters as they are met.
    engine::Variant passed_;
    engine::Variant space_;
    // Surfaces of the colliders of this decision, since groups are slow to ask for.
    std::vector<std::pair<GDExtensionObjectPtr, sf_surface>> known_;
};

// The jump pads, zip lines, teleporters and jetpacks of the scene that `node` is in: nodes in the groups of these. A zip line or teleporter leads to
// its child named "To"; one without is left out, with an error.
std::vector<sf_device> find_devices(const engine::Variant& node);

}  // namespace surefoot
