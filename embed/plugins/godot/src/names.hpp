// Abilities as scripts name them.
#pragma once

#include "surefoot.h"

#include <string>

namespace surefoot {

inline const char* name_of(sf_ability ability) {
    switch (ability) {
        case SF_WALK: return "walk";
        case SF_JUMP: return "jump";
        case SF_DOUBLE_JUMP: return "double_jump";
        case SF_PAD: return "pad";
        case SF_ZIP_LINE: return "zip_line";
        case SF_TELEPORTER: return "teleporter";
        case SF_JETPACK: return "jetpack";
        case SF_CLIMB: return "climb";
        case SF_MANTLE: return "mantle";
        case SF_SWIM: return "swim";
        case SF_CROUCH: return "crouch";
        case SF_DASH: return "dash";
        default: return "unknown";
    }
}

// The ability with a name; SF_WALK if there is none.
inline sf_ability ability_of(const std::string& name) {
    for (sf_ability ability = SF_JUMP; ability <= SF_DASH; ability++) {
        if (name == name_of(ability)) {
            return ability;
        }
    }
    return SF_WALK;
}

}  // namespace surefoot
