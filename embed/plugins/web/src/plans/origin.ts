// Where a level lies on its map. An import moves a level so that no coordinate of the map is negative.

import { checkVec3 } from '../checks.ts'
import type { Vec3 } from '../vec3.ts'

/** Margin around levels, and the height of their lowest point, m. */
const [MARGIN_M, LOWEST_M] = [2, 1]

/**
 * Where the origin of a level lies on the map that an import makes of it, m, for levels up to 996 m wide. `lowest` is the lowest corner
 * of the level's bounds: x, y and z at their least, pools included.
 */
export function originOf(lowest: Vec3): Vec3 {
  const { x, y, z } = checkVec3('lowest', lowest)
  return { x: MARGIN_M - x, y: LOWEST_M - y, z: MARGIN_M - z }
}
