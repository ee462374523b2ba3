// When a character has arrived: it stands near its goal, and nothing solid is between. The rule is that of
// core/world/src/arrival.rs.

import { checkRange, checkVec3 } from '../checks.ts'
import { distance, scale, subtract, type Vec3 } from '../vec3.ts'
import { REACHED_WITHIN_M } from './attempt.ts'
import type { Body } from './body.ts'
import { type CastRays, checkHits, RAY_RANGE_M, Surface } from './rays.ts'

/** Heights of the rays to a goal, as shares of the body's height. */
const RAY_HEIGHTS = [0.25, 0.75]
/** What continuous ground rises at most besides its slope: at least, and more than steps, m. */
const LEAST_RISE_M = 0.35
const RISE_SLACK_M = 0.05
/** Difference in height between the feet and a goal that always passes, m. */
const LIFT_M = 0.6

/** Where a character is, and whether it stands on walkable ground. `AgentState` has both. */
export interface Footing {
  feet: Vec3
  isGrounded: boolean
}

/** A goal that one arrives at. */
export interface Arrival {
  goal: Vec3
  /** Distance from the goal within which the feet must stand, 0 to 30 m; absent: 1 m. */
  radius?: number | undefined
}

/**
 * Completes an arrival.
 * @throws SurefootError that names the first value which cannot be used.
 */
export function checkArrival({ goal, radius = REACHED_WITHIN_M }: Arrival): { goal: Vec3; radius: number } {
  return { goal: checkVec3('goal', goal), radius: checkRange('radius', radius, 0, RAY_RANGE_M) }
}

/**
 * Whether a body has arrived: it stands within the radius, no higher or lower than steps and slopes take it, and rays
 * to the goal hit nothing solid. Casts two rays, and only if all else is so.
 */
export function hasArrived(body: Body, { feet, isGrounded }: Footing, arrival: Arrival, castRays: CastRays): boolean {
  const { goal, radius } = checkArrival(arrival)
  const offset = subtract(goal, feet)
  const far = distance(goal, feet)
  const step = Math.max(body.stepHeight + RISE_SLACK_M, LEAST_RISE_M)
  const rise = step + Math.hypot(offset.x, offset.z) * Math.tan(body.maxSlope)
  if (!isGrounded || far > radius || Math.abs(offset.y) > Math.max(rise, LIFT_M)) return false
  if (far === 0) return true
  const direction = scale(offset, 1 / far)
  const hits = castRays(
    new Float32Array(RAY_HEIGHTS.flatMap((share) => [feet.x, feet.y + share * body.height, feet.z])),
    new Float32Array(RAY_HEIGHTS.flatMap(() => [direction.x, direction.y, direction.z])),
  )
  checkHits(hits, RAY_HEIGHTS.length)
  return RAY_HEIGHTS.every((_, ray) => hits.surfaces[ray] !== Surface.ground || hits.distances[ray]! >= far)
}
