// Observations, version 3: 64 rays with five values each and 49 values of the agent's own state, as one row of 369 values.
//
// The layout is that of docs/reference/observations.md. Policies know nothing else, so that each value here must be as it is there; a test compares
// rows with those of the program.

import { checkRange, checkVec3 } from '../checks.ts'
import { distance, lengthOf, scale, subtract, toLocal, type Vec3, ZERO } from '../vec3.ts'
import type { Attempt } from './attempt.ts'
import { type Body, bodyFeatures } from './body.ts'
import { bestTransport, DEVICE_RANGE_M, nearest, type PlacedDevices } from './devices.ts'
import { RAY_COUNT, RAY_RANGE_M, type RayHits, Surface } from './rays.ts'

/** Version of the layout. */
export const OBSERVATION_VERSION = 3
/** Values of an observation. */
export const OBSERVATION_LEN = 369

/** Where the state begins, after the values of the rays. */
const STATE_AT = RAY_COUNT * 5
/** Speed that is 1 in an observation, m/s. */
const SPEED = 12

/** Where a character is and how it moves. */
export interface AgentState {
  /** Lowest point of the capsule, m. */
  feet: Vec3
  /** m/s. */
  velocity: Vec3
  /** Heading, rad: 0 faces +z, growing counter-clockwise seen from above, as `rotation.y` of three.js does. */
  yaw: number
  /** Whether it stands on walkable ground. */
  isGrounded: boolean
  /** Whether it could jump now, from the ground or in the air. */
  canJump: boolean
  /** Whether it rides a zip line. */
  isRiding?: boolean
  /** Share of its breath that it has used up under water, 0 to 1. */
  breathUsed?: number
  /** Thrust that its jetpack has left, s. */
  jetpackSeconds?: number
}

/** What an agent remembers of its last decision. */
export interface LastDecision {
  /** Velocity when it was made, m/s. */
  velocity: Vec3
  /** Forward, strafe, turn, jump. */
  action: readonly [number, number, number, number]
}

export const NO_DECISION: LastDecision = { velocity: ZERO, action: [0, 0, 0, 0] }

/** Everything in an observation besides rays. */
export interface Situation {
  body: Body
  devices: PlacedDevices
  state: AgentState
  attempt: Attempt
  last: LastDecision
}

/** Channel and value of each surface in an observation, by number; ground has none. */
const CHANNELS: Record<number, readonly [channel: number, value: number]> = {
  [Surface.water]: [1, 1],
  [Surface.lava]: [2, 1],
  [Surface.pad]: [3, 1],
  [Surface.zipLine]: [4, 1],
  [Surface.teleporter]: [4, 0.7],
  [Surface.jetpack]: [4, 0.4],
}

/**
 * Checks the state of an agent.
 * @throws SurefootError that names the value to change.
 */
export function checkState(name: string, state: AgentState): void {
  checkVec3(`${name}.feet`, state?.feet)
  checkVec3(`${name}.velocity`, state.velocity)
  checkRange(`${name}.yaw`, state.yaw, -Number.MAX_VALUE, Number.MAX_VALUE)
  checkRange(`${name}.breathUsed`, state.breathUsed ?? 0, 0, 1)
  checkRange(`${name}.jetpackSeconds`, state.jetpackSeconds ?? 0, 0, Number.MAX_VALUE)
}

/** Writes an observation into `row`, from hits that were checked; those of the agent begin at ray `firstRay`. */
export function observe(row: Float32Array, hits: RayHits, firstRay: number, situation: Situation): void {
  row.fill(0)
  for (let ray = 0; ray < RAY_COUNT; ray++) {
    const [far, surface] = [hits.distances[firstRay + ray]!, hits.surfaces[firstRay + ray]!]
    if (surface === Surface.none || far > RAY_RANGE_M) continue
    row[ray] = 1 - far / RAY_RANGE_M
    const channel = CHANNELS[surface]
    if (channel !== undefined) row[channel[0] * RAY_COUNT + ray] = channel[1]
  }
  row.set(stateVector(situation), STATE_AT)
}

/** The values of an observation besides rays; vectors are in the body's frame. */
function stateVector({ body, devices, state, attempt, last }: Situation): number[] {
  const { feet, yaw, velocity } = state
  const flag = (on: boolean | undefined) => (on ? 1 : 0)
  const local = (vector: Vec3) => Object.values(toLocal(vector, yaw))
  const proximity = (far: number) => Math.max(1 - far / DEVICE_RANGE_M, 0)
  const bearing = (place: Vec3 | undefined) => {
    if (place === undefined) return [0, 0, 0, 0]
    const far = distance(place, feet)
    return [...local(scale(subtract(place, feet), 1 / Math.max(far, 1e-3))), proximity(far)]
  }
  const transport = bestTransport(devices, feet, attempt.goal)
  return [
    ...goalFeatures(subtract(attempt.goal, feet), yaw),
    ...local(scale(velocity, 1 / SPEED)),
    ...local(scale(subtract(velocity, last.velocity), 1 / SPEED)),
    ...last.action,
    flag(state.isGrounded),
    flag(state.isGrounded || state.canJump),
    attempt.patienceUsed,
    state.breathUsed ?? 0,
    ...bearing(nearest(devices.pads, feet)),
    ...bearing(transport?.from),
    transport === undefined ? 0 : proximity(distance(transport.to, attempt.goal)),
    ...bearing(nearest(devices.jetpacks, feet)),
    Math.min((state.jetpackSeconds ?? 0) / 5, 1),
    flag(state.isRiding),
    ...bodyFeatures(body),
  ]
}

/** Distance and direction of the goal, which lies at `offset` from the feet, m. */
function goalFeatures(offset: Vec3, yaw: number): number[] {
  const far = lengthOf(offset)
  const { x, y, z } = toLocal(scale(offset, 1 / Math.max(far, 1e-3)), yaw)
  const horizontal = Math.hypot(offset.x, offset.z)
  const height = Math.max(-1.5, Math.min(offset.y / 8, 1.5))
  return [Math.min(far / 50, 4), x, y, z, Math.min(horizontal / 8, 1.5), height]
}
