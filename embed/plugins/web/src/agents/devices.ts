// The devices of a level; observations show the nearest ones.

import { checkVec3 } from '../checks.ts'
import { distance, type Vec3 } from '../vec3.ts'

/** Distance beyond which no device is noticed, m. */
export const DEVICE_RANGE_M = 50

/** A device that leads from one place to another. */
export interface Transport {
  from: Vec3
  to: Vec3
}

/** A teleporter, which may lead back as well. */
export interface Teleporter extends Transport {
  twoWay?: boolean
}

/** Devices by kind: their places on the ground, m. */
export interface Devices {
  pads?: Vec3[]
  zipLines?: Transport[]
  teleporters?: Teleporter[]
  jetpacks?: Vec3[]
}

/** Devices, prepared for queries. */
export interface PlacedDevices {
  pads: Vec3[]
  /** Entrances and exits of zip lines and teleporters. */
  transports: Transport[]
  jetpacks: Vec3[]
}

/**
 * Prepares devices for queries.
 * @throws SurefootError that names a place which is not finite.
 */
export function placeDevices({ pads = [], zipLines = [], teleporters = [], jetpacks = [] }: Devices): PlacedDevices {
  const places = (name: string, list: Vec3[]) => list.map((place, idx) => checkVec3(`devices.${name}[${idx}]`, place))
  const transports = (name: string, list: Transport[]) =>
    list.map(({ from, to }, idx) => ({
      from: checkVec3(`devices.${name}[${idx}].from`, from),
      to: checkVec3(`devices.${name}[${idx}].to`, to),
    }))
  const bothWays = teleporters.flatMap((one) => (one.twoWay ? [one, { from: one.to, to: one.from }] : [one]))
  return {
    pads: places('pads', pads),
    transports: [...transports('zipLines', zipLines), ...transports('teleporters', bothWays)],
    jetpacks: places('jetpacks', jetpacks),
  }
}

/** The place that is nearest to `feet` within reach. */
export function nearest(places: Vec3[], feet: Vec3): Vec3 | undefined {
  let [best, least]: [Vec3 | undefined, number] = [undefined, DEVICE_RANGE_M]
  for (const place of places) {
    const far = distance(place, feet)
    if (far < least) [best, least] = [place, far]
  }
  return best
}

/**
 * The device that brings the goal nearest: the smallest sum of the distances to its entrance and from its exit, among those with their
 * entrance within reach.
 */
export function bestTransport({ transports }: PlacedDevices, feet: Vec3, goal: Vec3): Transport | undefined {
  let [best, least]: [Transport | undefined, number] = [undefined, Infinity]
  for (const transport of transports) {
    const far = distance(transport.from, feet)
    const sum = far + distance(transport.to, goal)
    if (far <= DEVICE_RANGE_M && sum < least) [best, least] = [transport, sum]
  }
  return best
}
