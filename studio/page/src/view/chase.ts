// Where the camera stands while it follows an NPC: behind it as seen from its goal, and in front of rock. No renderer here.

import { shortestTurn } from './orbit'
import type { Place } from './viewport.types'

/** Distance from the NPC, m: its body, its next legs and its rays are seen. */
export const CHASE_M = 18
/** Turned so far from straight behind, so that the NPC does not hide its own way, rad. */
const ASIDE = 0.55
/** Angles from the vertical, rad: the lower the view the better, but rock may be in its way. */
const POLARS = [1.12, 0.9, 0.66, 0.42]
/** A goal nearer than this gives no direction, m. */
const NEAR_M = 2
/** The camera turns no faster than this by itself, and where rock hides the NPC, rad/s. */
const TURN_RATE = 0.4
const HURRIED_RATE = 1.6

export interface Angles {
  azimuth: number
  polar: number
}

/** The best free angles; the side on which the camera stands already comes first. */
export function chaseAngles(
  at: Place,
  towards: Place | undefined,
  present: Angles,
  isFree: (angles: Angles) => boolean,
): Angles {
  const [dx, dz] = [(towards?.x ?? at.x) - at.x, (towards?.z ?? at.z) - at.z]
  const aside = (by: number): number => Math.atan2(-dx, -dz) + by
  const sides =
    Math.hypot(dx, dz) < NEAR_M
      ? [present.azimuth]
      : [aside(ASIDE), aside(-ASIDE)].sort((a, b) => turnTo(a, present) - turnTo(b, present))
  const tries = POLARS.flatMap((polar) => sides.map((azimuth) => ({ azimuth, polar })))
  return tries.find(isFree) ?? tries[tries.length - 1]!
}

const turnTo = (azimuth: number, present: Angles): number => Math.abs(shortestTurn(present.azimuth, azimuth))

/** Turns `angles` towards `wanted` as far as `elapsed` ms allow; `hurried`: the NPC cannot be seen. */
export function turnCalmly(angles: Angles, wanted: Angles, elapsed: number, hurried = false): void {
  const most = ((hurried ? HURRIED_RATE : TURN_RATE) * elapsed) / 1000
  const limited = (turn: number): number => Math.min(most, Math.max(-most, turn))
  angles.azimuth += limited(shortestTurn(angles.azimuth, wanted.azimuth))
  angles.polar += limited(wanted.polar - angles.polar)
}
