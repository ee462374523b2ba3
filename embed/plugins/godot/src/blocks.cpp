#include "blocks.hpp"

#include "frames.hpp"

#include <algorithm>
#include <cmath>

namespace surefoot {

using engine::Array;
using engine::push_error;
using engine::Variant;

namespace {

constexpr int64_t corner_count = 8;
// Corners of an AABB that are neighbours of corner 0, along x and along z.
constexpr int64_t corner_along_x = 4, corner_along_z = 1;

constexpr const char* shape_class = "CollisionShape3D";

// What Godot calls an object in its log.
std::string label_of(const Variant& node) { return node.call("to_string").text(); }

// The horizontal share of an edge.
float levelness(sf_vec3 edge) { return std::hypot(edge.x, edge.z) / frames::length(edge); }

// The smallest upright box around the shape of a CollisionShape3D that is turned with it.
sf_block block_around(const Variant& node) {
    const Variant box = node.call("get_shape").call("get_debug_mesh").call("get_aabb");
    sf_vec3 corners[corner_count];
    for (int64_t idx = 0; idx < corner_count; idx++) {
        corners[idx] = node.call("to_global", box.call("get_endpoint", idx)).vector3();
    }
    // What lies on its side is turned like its other edge.
    const sf_vec3 x = frames::minus(corners[corner_along_x], corners[0]);
    const sf_vec3 z = frames::minus(corners[corner_along_z], corners[0]);
    const float yaw = levelness(x) >= levelness(z) ? std::atan2(-x.z, x.x) : std::atan2(z.x, z.z);
    const float cosine = std::cos(yaw), sine = std::sin(yaw);
    sf_vec3 low{INFINITY, INFINITY, INFINITY}, high{-INFINITY, -INFINITY, -INFINITY};
    for (const sf_vec3& corner : corners) {
        const sf_vec3 turned{corner.x * cosine - corner.z * sine, corner.y, corner.x * sine + corner.z * cosine};
        low = {std::min(low.x, turned.x), std::min(low.y, turned.y), std::min(low.z, turned.z)};
        high = {std::max(high.x, turned.x), std::max(high.y, turned.y), std::max(high.z, turned.z)};
    }
    const float along = (low.x + high.x) / 2.0f, across = (low.z + high.z) / 2.0f;
    const sf_vec3 foot{along * cosine + across * sine, low.y, across * cosine - along * sine};
    return {foot, high.x - low.x, high.z - low.z, high.y - low.y, yaw};
}

// Whether characters collide with the shape.
bool is_solid(const Variant& node) {
    return !node.call("is_disabled").boolean() && node.call("get_shape").object() != nullptr &&
           !node.call("get_parent").call("is_class", "Area3D").boolean();
}

}  // namespace

bool read_blocks(const std::string& what, const Array& nodes, std::vector<SceneBlock>& blocks) {
    const int64_t node_count = nodes.call("size").integer();
    for (int64_t idx = 0; idx < node_count; idx++) {
        const Variant node = nodes.at(idx);
        if (node.object() == nullptr || !node.call("is_class", "Node3D").boolean() ||
            !node.call("is_inside_tree").boolean()) {
            push_error(what + ": element " + std::to_string(idx) + " is no Node3D of the scene: leave it out");
            return false;
        }
        Array shapes;
        if (node.call("is_class", shape_class).boolean()) {
            shapes.call("append", node);
        } else {
            shapes.call("append_array", node.call("find_children", "*", shape_class, true, false));
        }
        const int64_t shape_count = shapes.call("size").integer();
        if (shape_count == 0) {
            push_error(what + ": " + label_of(node) + " has no CollisionShape3D: give it one, or leave it out");
            return false;
        }
        for (int64_t shape_idx = 0; shape_idx < shape_count; shape_idx++) {
            const Variant shape = shapes.at(shape_idx);
            if (is_solid(shape)) {
                blocks.push_back({label_of(node), block_around(shape)});
            }
        }
    }
    return true;
}

}  // namespace surefoot
