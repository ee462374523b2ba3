// The camera as a point of interest, a distance and two angles, and how gestures change them. No renderer here.

import type { Place } from './viewport.types'

/** Field of view from top to bottom; in the top view it is so narrow that uprights hardly lean. */
const WIDE = (50 * Math.PI) / 180
const NARROW = (5 * Math.PI) / 180
const NEAREST_M = 2.5
const FARTHEST_M = 4000
const LOWEST_POLAR = (87 * Math.PI) / 180

export interface OrbitPose {
  target: Place
  /** From the target at the wide field of view, m; decides how much is seen. */
  distance: number
  /** Around the vertical; 0 looks towards -z. */
  azimuth: number
  /** From the vertical; 0 looks straight down. */
  polar: number
  /** 0: a usual perspective, 1: nearly parallel. */
  flat: number
}

/** The turn from one direction to another, the short way round, rad. */
export function shortestTurn(from: number, to: number): number {
  const turn = (to - from) % (2 * Math.PI)
  return turn > Math.PI ? turn - 2 * Math.PI : turn < -Math.PI ? turn + 2 * Math.PI : turn
}

export interface Lens {
  eye: Place
  fieldOfView: number
  near: number
  far: number
}

export function copyPose(pose: OrbitPose): OrbitPose {
  return { ...pose, target: { ...pose.target } }
}

function fieldOfViewOf({ flat }: OrbitPose): number {
  return WIDE + (NARROW - WIDE) * Math.min(1, Math.max(0, flat))
}

/** Where the camera stands for a pose; `extent` is the diagonal of the map, m. */
export function lensOf(pose: OrbitPose, extent: number): Lens {
  const fieldOfView = fieldOfViewOf(pose)
  const distance = (pose.distance * Math.tan(WIDE / 2)) / Math.tan(fieldOfView / 2)
  const across = Math.sin(pose.polar) * distance
  const eye = {
    x: pose.target.x + Math.sin(pose.azimuth) * across,
    y: pose.target.y + Math.cos(pose.polar) * distance,
    z: pose.target.z + Math.cos(pose.azimuth) * across,
  }
  const near = Math.max(Math.min(pose.distance * 0.02, 2), 0.1, distance - pose.distance - extent)
  return { eye, fieldOfView, near, far: distance + extent * 1.5 + 50 }
}

/** Metres that a pixel covers at the target. */
export function metresPerPixel(pose: OrbitPose, height: number): number {
  return (2 * pose.distance * Math.tan(WIDE / 2)) / Math.max(1, height)
}

export function rotate(pose: OrbitPose, dx: number, dy: number, height: number): void {
  const speed = Math.PI / Math.max(1, height)
  pose.azimuth -= dx * speed
  if (pose.flat < 0.5) {
    pose.polar = Math.min(LOWEST_POLAR, Math.max(0.02, pose.polar - dy * speed))
  }
}

/** Moves the target over level ground, as if it was grabbed and drawn by so many pixels. */
export function pan(pose: OrbitPose, dx: number, dy: number, height: number): void {
  const scale = metresPerPixel(pose, height)
  const forward = (dy * scale) / Math.max(Math.cos(pose.polar), 0.3)
  const sideways = -dx * scale
  pose.target.x += Math.cos(pose.azimuth) * sideways - Math.sin(pose.azimuth) * forward
  pose.target.z += -Math.sin(pose.azimuth) * sideways - Math.cos(pose.azimuth) * forward
}

/** Comes nearer by `factor` (below 1) to `towards`, which stays where it is on the screen. */
export function zoom(pose: OrbitPose, factor: number, towards: Place | undefined): void {
  const distance = Math.min(FARTHEST_M, Math.max(NEAREST_M, pose.distance * factor))
  const share = distance / pose.distance
  pose.distance = distance
  if (towards) {
    const { target } = pose
    target.x = towards.x + (target.x - towards.x) * share
    target.y = towards.y + (target.y - towards.y) * share
    target.z = towards.z + (target.z - towards.z) * share
  }
}

/** Share of the picture that a framed box fills. */
const FILLED = 0.94

/** The target and the distance from which a box is seen whole and in the middle, for the angles of `pose`. */
export function fitBox(pose: OrbitPose, low: Place, high: Place, aspect: number): { target: Place; distance: number } {
  const away = Math.tan(WIDE / 2) / Math.tan(fieldOfViewOf(pose) / 2)
  const tangent = Math.tan(WIDE / 2)
  const [sin, cos] = [Math.sin(pose.azimuth), Math.cos(pose.azimuth)]
  const [sinPolar, cosPolar] = [Math.sin(pose.polar), Math.cos(pose.polar)]
  let target = { x: (low.x + high.x) / 2, y: (low.y + high.y) / 2, z: (low.z + high.z) / 2 }
  let distance = Math.max(1, Math.hypot(high.x - low.x, high.y - low.y, high.z - low.z))
  for (let round = 0; round < 12; round += 1) {
    const seen = { left: Infinity, right: -Infinity, bottom: Infinity, top: -Infinity }
    for (let corner = 0; corner < 8; corner += 1) {
      const x = (corner & 1 ? high.x : low.x) - target.x
      const y = (corner & 2 ? high.y : low.y) - target.y
      const z = (corner & 4 ? high.z : low.z) - target.z
      const outward = x * sin + z * cos
      const depth = 1 - (y * cosPolar + outward * sinPolar) / (distance * away)
      const across = (x * cos - z * sin) / (distance * tangent * aspect * Math.max(0.05, depth))
      const up = (y * sinPolar - outward * cosPolar) / (distance * tangent * Math.max(0.05, depth))
      seen.left = Math.min(seen.left, across)
      seen.right = Math.max(seen.right, across)
      seen.bottom = Math.min(seen.bottom, up)
      seen.top = Math.max(seen.top, up)
    }
    const sideways = ((seen.left + seen.right) / 2) * distance * tangent * aspect
    const forward = ((seen.bottom + seen.top) / 2) * distance * tangent
    // The target keeps its height, so a vertical offset on the screen is corrected along the ground.
    const along = forward / Math.max(cosPolar, 0.3)
    target = { x: target.x + cos * sideways - sin * along, y: target.y, z: target.z - sin * sideways - cos * along }
    distance *= Math.max(seen.right - seen.left, seen.top - seen.bottom) / (2 * FILLED)
  }
  return { target, distance }
}

export function samePose(a: OrbitPose, b: OrbitPose): boolean {
  return (
    a.target.x === b.target.x &&
    a.target.y === b.target.y &&
    a.target.z === b.target.z &&
    a.distance === b.distance &&
    a.azimuth === b.azimuth &&
    a.polar === b.polar &&
    a.flat === b.flat
  )
}

/** Brings `shown` nearer to `goal` as after `elapsed` ms; tells whether there is still a way to go. */
export function approach(shown: OrbitPose, goal: OrbitPose, elapsed: number, timeMs: number): boolean {
  const share = timeMs > 0 ? 1 - Math.exp(-elapsed / timeMs) : 1
  const away =
    Math.hypot(goal.target.x - shown.target.x, goal.target.y - shown.target.y, goal.target.z - shown.target.z) /
      goal.distance +
    Math.abs(Math.log(goal.distance / shown.distance)) +
    Math.abs(goal.azimuth - shown.azimuth) +
    Math.abs(goal.polar - shown.polar) +
    Math.abs(goal.flat - shown.flat)
  const step = away < 5e-4 ? 1 : share
  for (const axis of ['x', 'y', 'z'] as const) {
    shown.target[axis] += (goal.target[axis] - shown.target[axis]) * step
  }
  shown.distance *= (goal.distance / shown.distance) ** step
  for (const part of ['azimuth', 'polar', 'flat'] as const) {
    shown[part] += (goal[part] - shown[part]) * step
  }
  return step < 1
}
