#include "sight.hpp"

#include "frames.hpp"

namespace surefoot {

using engine::Variant;

namespace {

constexpr int most_characters_in_a_ray = 64;

struct Group {
    const char* name;
    sf_surface surface;
    bool is_device;
    bool leads_somewhere;
};

constexpr Group groups[] = {
    {"surefoot_water", SF_SURFACE_WATER, false, false},   {"surefoot_lava", SF_SURFACE_LAVA, false, false},
    {"surefoot_pad", SF_SURFACE_PAD, true, false},        {"surefoot_zip_line", SF_SURFACE_ZIP_LINE, true, true},
    {"surefoot_teleporter", SF_SURFACE_TELEPORTER, true, true}, {"surefoot_jetpack", SF_SURFACE_JETPACK, true, false},
};

}  // namespace

Sight::Sight(const Variant& body)
    : body_(body),
      query_(Variant::singleton("ClassDB").call("instantiate", "PhysicsRayQueryParameters3D")),
      passed_(Variant::empty(GDEXTENSION_VARIANT_TYPE_ARRAY)) {
    pass_through(body.call("get_rid"));
}

void Sight::set_mask(int64_t mask) { query_.call("set_collision_mask", mask); }

void Sight::set_sees_areas(bool sees_areas) { query_.call("set_collide_with_areas", sees_areas); }

void Sight::pass_through(const Variant& rid) {
    passed_.call("append", rid);
    query_.call("set_exclude", passed_);
}

void Sight::cast(const sf_ray* rays, size_t ray_count, sf_hit* hits) {
    known_.clear();
    space_ = body_.call("get_world_3d").call("get_direct_space_state");
    for (size_t idx = 0; idx < ray_count; idx++) {
        hits[idx] = cast_one(rays[idx]);
    }
    space_ = Variant();
}

sf_hit Sight::cast_one(const sf_ray& ray) {
    const sf_vec3 &from = ray.origin, &direction = ray.direction;
    const sf_vec3 reach{direction.x * SF_RAY_RANGE, direction.y * SF_RAY_RANGE, direction.z * SF_RAY_RANGE};
    query_.call("set_from", from);
    query_.call("set_to", frames::plus(from, reach));
    for (int characters_passed = 0; characters_passed < most_characters_in_a_ray; characters_passed++) {
        const Variant found = space_.call("intersect_ray", query_);
        const Variant collider = found.at("collider");
        if (found.call("is_empty").boolean()) {
            return {};
        }
        if (!collider.is_nil() && collider.call("is_class", "CharacterBody3D").boolean()) {
            // Policies take what their rays meet for the level, where other characters do not belong.
            pass_through(found.at("rid"));
            continue;
        }
        sf_hit hit{};
        hit.distance = frames::length(frames::minus(found.at("position").vector3(), from));
        hit.surface = surface_of(collider);
        return hit;
    }
    return {};
}

sf_surface Sight::surface_of(const Variant& collider) {
    const GDExtensionObjectPtr object = collider.object();
    if (object == nullptr) {
        return SF_SURFACE_GROUND;
    }
    for (const auto& [known, surface] : known_) {
        if (known == object) {
            return surface;
        }
    }
    sf_surface surface = SF_SURFACE_GROUND;
    for (const Group& group : groups) {
        if (collider.call("is_in_group", group.name).boolean()) {
            surface = group.surface;
        }
    }
    known_.emplace_back(object, surface);
    return surface;
}

std::vector<sf_device> find_devices(const Variant& node) {
    std::vector<sf_device> devices;
    const Variant tree = node.call("get_tree");
    for (const Group& group : groups) {
        const Variant members = group.is_device ? tree.call("get_nodes_in_group", group.name) : Variant::empty(GDEXTENSION_VARIANT_TYPE_ARRAY);
        const int64_t member_count = members.call("size").integer();
        for (int64_t idx = 0; idx < member_count; idx++) {
            const Variant member = members.at(idx);
            sf_device device{};
            device.kind = group.surface;
            if (!member.call("is_class", "Node3D").boolean()) {
                continue;
            }
            device.from = member.call("get_global_position").vector3();
            if (group.leads_somewhere) {
                const Variant to = member.call("find_child", "To", false, false);
                if (to.object() == nullptr) {
                    engine::push_error(std::string("a node in the group ") + group.name + " leads nowhere: give it a child Marker3D named To at its other end");
                    continue;
                }
                device.to = to.call("get_global_position").vector3();
            }
            devices.push_back(device);
        }
    }
    return devices;
}

}  // namespace surefoot
