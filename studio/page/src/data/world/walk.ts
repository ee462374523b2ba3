// How a player walks: over the ground, up low steps and down ledges, but not through walls and not off the map.

import type { Place } from '../../view/viewport.types'

/** Metres from a place to the ground or a wall, in a direction of length 1; undefined: there is none. */
export type Cast = (origin: Place, direction: Place) => number | undefined

/** Velocity over level ground, m/s. */
export interface Level {
  x: number
  z: number
}

export const STILL: Level = { x: 0, z: 0 }

const WALK_MPS = 3
const RUN_MPS = 6
const FALL_MPS = 8
/** Highest step that the player takes, m. */
const STEP_M = 0.5
/** Deepest ledge that the player walks off, m. */
const DROP_M = 3
/** Ground at most this high above the feet lifts the player onto it, m: the map was edited, or is now shown in more detail. */
const LIFT_M = 3
/** From the middle of the body to the walls beside it and ahead of it, m. */
const RADIUS_M = 0.3
/** Heights at which walls stop the body, m over the feet. */
const WALL_HEIGHTS_M = [STEP_M + 0.05, 1.1, 1.7] as const
/** Turns that the player tries to get along a wall, rad. */
const TURNS = [0, 30, -30, 60, -60, 80, -80].map((degrees) => (degrees * Math.PI) / 180)
/** A longer way is walked in parts, m. */
const PART_M = 0.25
/** This near to a place, the player has arrived, m. */
const ARRIVED_M = 0.1

const DOWN: Place = { x: 0, y: -1, z: 0 }

export const speedOf = (isRunning: boolean): number => (isRunning ? RUN_MPS : WALK_MPS)

/** Directions of the keys, as seen from the camera: to the right, and ahead. */
const KEYS: Readonly<Record<string, readonly [right: number, ahead: number]>> = {
  KeyW: [0, 1],
  ArrowUp: [0, 1],
  KeyS: [0, -1],
  ArrowDown: [0, -1],
  KeyA: [-1, 0],
  ArrowLeft: [-1, 0],
  KeyD: [1, 0],
  ArrowRight: [1, 0],
}

export const isWalkKey = (code: string): boolean => code in KEYS

/** Where the held keys lead, as seen by a camera that is turned by `azimuth`, rad; undefined: nowhere. */
export function velocityOfKeys(held: Iterable<string>, azimuth: number, speed: number): Level | undefined {
  let [right, ahead] = [0, 0]
  for (const code of held) {
    const [x, y] = KEYS[code] ?? [0, 0]
    right = Math.max(-1, Math.min(1, right + x))
    ahead = Math.max(-1, Math.min(1, ahead + y))
  }
  const length = Math.hypot(right, ahead)
  if (length === 0) return undefined
  const [sin, cos] = [Math.sin(azimuth), Math.cos(azimuth)]
  const scale = speed / length
  return { x: (cos * right - sin * ahead) * scale, z: (-sin * right - cos * ahead) * scale }
}

/** Straight towards a place, within `seconds` not beyond it; undefined: the player is there. */
export function velocityTowards(from: Place, to: Place, speed: number, seconds: number): Level | undefined {
  const [x, z] = [to.x - from.x, to.z - from.z]
  const distance = Math.hypot(x, z)
  if (distance < ARRIVED_M) return undefined
  const scale = Math.min(speed, distance / seconds) / distance
  return { x: x * scale, z: z * scale }
}

/** Where the player is after `seconds`. */
export function walk(from: Place, { x, z }: Level, seconds: number, cast: Cast): Place {
  const parts = Math.max(1, Math.ceil((Math.hypot(x, z) * seconds) / PART_M))
  const part = seconds / parts
  let at = from
  for (let done = 0; done < parts; done += 1) at = walkPart(at, x * part, z * part, part, cast)
  return at
}

/** One part of the way; along a wall if that is in the way. */
function walkPart(from: Place, dx: number, dz: number, seconds: number, cast: Cast): Place {
  for (const turn of dx === 0 && dz === 0 ? [] : TURNS) {
    const [sin, cos] = [Math.sin(turn), Math.cos(turn)]
    const [x, z] = [(cos * dx + sin * dz) * cos, (cos * dz - sin * dx) * cos]
    if (!isFree(from, x, z, cast)) continue
    const to = { x: from.x + x, y: from.y, z: from.z + z }
    const floor = floorBelow(to, STEP_M, DROP_M, cast)
    if (floor === undefined || isEdge(to, x, z, cast)) break
    return { ...to, y: fallTo(floor, from.y, seconds) }
  }
  const floor = floorBelow(from, STEP_M, Infinity, cast) ?? floorBelow(from, LIFT_M, 0, cast)
  return floor === undefined ? from : { ...from, y: fallTo(floor, from.y, seconds) }
}

/** Steps are taken at once; from ledges the player falls. */
function fallTo(floor: number, feet: number, seconds: number): number {
  return feet - floor > STEP_M ? Math.max(floor, feet - FALL_MPS * seconds) : floor
}

/** Height of the first ground below a point `above` m over the feet, at most `below` m under them. */
function floorBelow({ x, y, z }: Place, above: number, below: number, cast: Cast): number | undefined {
  const distance = cast({ x, y: y + above, z }, DOWN)
  return distance === undefined || distance > above + below ? undefined : y + above - distance
}

/** Whether a drop that is too deep, or the end of the map, is just ahead. */
function isEdge({ x, y, z }: Place, dx: number, dz: number, cast: Cast): boolean {
  const scale = RADIUS_M / Math.hypot(dx, dz)
  return floorBelow({ x: x + dx * scale, y, z: z + dz * scale }, WALL_HEIGHTS_M[0], DROP_M, cast) === undefined
}

/** Whether no wall is ahead: neither in the middle nor at the shoulders. */
function isFree({ x, y, z }: Place, dx: number, dz: number, cast: Cast): boolean {
  const length = Math.hypot(dx, dz)
  const direction = { x: dx / length, y: 0, z: dz / length }
  return WALL_HEIGHTS_M.every((height) =>
    [-0.8, 0, 0.8].every((side) => {
      const shoulder = side * RADIUS_M
      const origin = { x: x - direction.z * shoulder, y: y + height, z: z + direction.x * shoulder }
      const distance = cast(origin, direction)
      return distance === undefined || distance > length + RADIUS_M
    }),
  )
}
