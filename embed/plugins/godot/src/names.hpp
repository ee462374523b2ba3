// Abilities as scripts name them.
#pragma once

#include "surefoot.h"

#include <string>

namespace surefoot {

// The name of an ability of the body of a graph; without one, there are no moves of the body's own.
inline std::string name_of(sf_ability ability, const sf_graph* graph = nullptr) {
    sf_ability_info info{};
    info.struct_size = sizeof(info);
    sf_error error;
    return sf_graph_ability(graph, ability, &info, &error) == SF_OK ? info.name : "unknown";
}

// The ability with a name; SF_WALK if there is none.
inline sf_ability ability_of(const std::string& name) {
    for (sf_ability ability = SF_JUMP; ability < SF_OWN_MOVE; ability++) {
        if (name == name_of(ability)) {
            return ability;
        }
    }
    return SF_WALK;
}

}  // namespace surefoot
