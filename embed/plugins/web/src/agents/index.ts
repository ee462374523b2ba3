// Agents in the page: observations from its own rays, and decisions of a policy.

export { SurefootError } from '../checks.ts'
export type { Vec3 } from '../vec3.ts'
export { type Action, type AgentOptions, Agents, DECISION_SECONDS, DEFAULT_NOISE_SHARE } from './agents.ts'
export type { Arrival, Footing } from './arrival.ts'
export { PATIENCE, REACHED_WITHIN_M } from './attempt.ts'
export { type Body, DEFAULT_BODY } from './body.ts'
export type { Devices, Teleporter, Transport } from './devices.ts'
export { Locomotion, type MovePhase, type Pace } from './locomotion.ts'
export { type AgentState, OBSERVATION_LEN, OBSERVATION_VERSION } from './observation.ts'
export { ACTION_LEN, type Decided, Policy } from './policy.ts'
export { type CastRays, RAY_COUNT, RAY_RANGE_M, type RayHits, Surface } from './rays.ts'
