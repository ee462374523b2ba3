// The reader of `surefoot graph export --format unreal`, without types of the engine. It is tolerant: fields that it does not know are
// ignored, names may be written in snake, camel or Pascal case, points as arrays or as objects, and what describes a link may stand in
// `About` or beside its ends. Only the ends must be there.
#pragma once

#include "SurefootAdapter.h"

#include <string>
#include <vector>

namespace surefoot {

enum class LinkDirection { BothWays, LeftToRight, RightToLeft };

// One move off the ground, as a hint for an animation.
struct LinkLeap {
    std::string ability;
    Vector take_off;
    Vector apex;
    Vector landing;
    double seconds = 0.0;
};

// A link of a NavMesh. Places are on the map, on Unreal's axes, cm: LevelFrame::map_corner takes them to the level.
struct Link {
    Vector left;
    Vector right;
    LinkDirection direction = LinkDirection::LeftToRight;
    // Distance from its ends within which a link joins the NavMesh, cm.
    double snap_radius = 30.0;
    // The most demanding ability, such as "jump".
    std::string ability;
    // Cost of entering the link, cm of walking.
    double entering_cost = 0.0;
    // Estimated chance that an NPC with the policy gets through, 0 to 1.
    double chance = 1.0;
    double seconds = 0.0;
    std::vector<LinkLeap> leaps;
};

// Reads the text of a file; the error says what is wrong with it, and where.
Result<std::vector<Link>> parse_links(const std::string& text);

}  // namespace surefoot
