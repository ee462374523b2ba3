// Godot's frame and ours. Both are right-handed with y up and in metres, so that places, velocities and directions are the same; a
// character of Godot faces -z where one of ours faces +z, so that yaws differ by half a turn.
#pragma once

#include "surefoot.h"

#include <cmath>

namespace frames {

inline float yaw_of(float rotation_y) { return rotation_y + 3.14159265f; }
inline float rotation_of(float yaw) { return yaw - 3.14159265f; }

inline sf_vec3 plus(sf_vec3 a, sf_vec3 b) { return {a.x + b.x, a.y + b.y, a.z + b.z}; }
inline sf_vec3 minus(sf_vec3 a, sf_vec3 b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
inline float length(sf_vec3 a) { return std::sqrt(a.x * a.x + a.y * a.y + a.z * a.z); }

}  // namespace frames
