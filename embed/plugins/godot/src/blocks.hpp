// Nodes of the scene as the upright boxes that rehearsals know.
#pragma once

#include "engine.hpp"

namespace surefoot {

// A box in the coordinates of the scene, and what messages call its node.
struct SceneBlock {
    std::string label;
    sf_block block;
};

// Reads the boxes around the CollisionShape3D nodes that are or belong to `nodes`, without those that are disabled or
// belong to an Area3D. False, and an error that begins with `what`, if a node has none.
bool read_blocks(const std::string& what, const engine::Array& nodes, std::vector<SceneBlock>& blocks);

}  // namespace surefoot
