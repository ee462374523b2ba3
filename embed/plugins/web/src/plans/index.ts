// Plans in the page: proved graphs, and followers of plans.

export { SurefootError } from '../checks.ts'
export type { Vec3 } from '../vec3.ts'
export { Follower, type FollowerOptions, type Step, type Traversal } from './follower.ts'
export { Graph } from './graph.ts'
export type { Edge } from './graph-file.ts'
export { originOf } from './origin.ts'
export {
  ABILITIES,
  type Ability,
  chanceOf,
  type Leg,
  type LegEnds,
  type NoPath,
  type Plan,
  type Planner,
  type Query,
  secondsOf,
  type Stop,
} from './plan.ts'
