// The cone of 8 x 8 rays with which an agent sees, denser ahead, and what rays end on.

import { checkLength, SurefootError } from '../checks.ts'
import type { Vec3 } from '../vec3.ts'
import type { Body } from './body.ts'

/** Rays per row and per column of the cone. */
const RAY_SIDE = 8
/** Rays of an agent. */
export const RAY_COUNT = RAY_SIDE * RAY_SIDE
/** Reach of every ray, m. */
export const RAY_RANGE_M = 30

/** Height of the rays' origin as a share of the body's height. */
const EYE_HEIGHT_SHARE = 0.85
const RAD_PER_DEG = Math.PI / 180
/** Azimuth of each ray of a row, rad, positive to the right. */
const AZIMUTHS = [-80, -45, -22, -7, 7, 22, 45, 80].map((degrees) => degrees * RAD_PER_DEG)
/** Elevation of each row, rad. */
const ELEVATIONS = [-65, -42, -26, -14, -5, 6, 22, 45].map((degrees) => degrees * RAD_PER_DEG)

/** What a ray ends on; the numbers are those of the services' `Surface`. */
export const Surface = {
  /** Nothing within reach. */
  none: 0,
  /** Solid ground. */
  ground: 1,
  /** The surface of water, which drowns characters after five seconds. */
  water: 2,
  /** The surface of lava, or any other place where a character must not go. */
  lava: 3,
  pad: 4,
  zipLine: 5,
  teleporter: 6,
  jetpack: 7,
} as const
export type Surface = (typeof Surface)[keyof typeof Surface]

/** What rays hit: for each ray the distance to the first surface, m, and which one it is. */
export interface RayHits {
  /** A distance beyond the rays' reach, or an infinite one, is nothing hit. */
  distances: ArrayLike<number>
  /** Values of `Surface`. */
  surfaces: ArrayLike<number>
}

/**
 * Casts rays in the page's scene. Origins and unit directions are x, y, z for each ray, one ray after another: 64 for
 * each agent that decides, and 2 for one that may have arrived. Rays should pass through characters.
 */
export type CastRays = (origins: Float32Array, directions: Float32Array) => RayHits

/** Where the rays of a body begin, m. */
export function eyeOf(body: Body, feet: Vec3): Vec3 {
  return { ...feet, y: feet.y + body.height * EYE_HEIGHT_SHARE }
}

/** Writes the rays of a body as those of agent `row`: row by row from the lowest elevation, each from left to right. */
export function writeRays(
  body: Body,
  { feet, yaw }: { feet: Vec3; yaw: number },
  row: number,
  origins: Float32Array,
  directions: Float32Array,
): void {
  const eye = eyeOf(body, feet)
  let at = row * RAY_COUNT * 3
  for (const elevation of ELEVATIONS) {
    const [rise, reach] = [Math.sin(elevation), Math.cos(elevation)]
    for (const azimuth of AZIMUTHS) {
      // To the right is clockwise, against the sense of yaw.
      const heading = yaw - azimuth
      origins.set([eye.x, eye.y, eye.z], at)
      directions.set([Math.sin(heading) * reach, rise, Math.cos(heading) * reach], at)
      at += 3
    }
  }
}

/**
 * Checks what rays of agents hit.
 * @throws SurefootError if there are too many or too few of them, or a value makes no sense.
 */
export function checkHits(hits: RayHits, rayCount: number): void {
  checkLength('distances that castRays returned', hits?.distances, rayCount)
  checkLength('surfaces that castRays returned', hits.surfaces, rayCount)
  for (let idx = 0; idx < rayCount; idx++) {
    const [distance, surface] = [hits.distances[idx]!, hits.surfaces[idx]!]
    if (!(surface >= Surface.none && surface <= Surface.jetpack && Number.isInteger(surface))) {
      throw new SurefootError(`surfaces[${idx}] of castRays is ${surface}: it must be a value of Surface, 0 to 7`)
    }
    if (surface !== Surface.none && !(distance >= 0)) {
      throw new SurefootError(`distances[${idx}] of castRays is ${distance}: it must be 0 m or more`)
    }
  }
}
