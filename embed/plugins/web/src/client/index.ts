// The services from a page.

export { SurefootError } from '../checks.ts'
export type { Vec3 } from '../vec3.ts'
export { type Addresses, connect, type ImportedLevel, type ImportOptions, type NewNpc, Surefoot } from './client.ts'
export { poseAt, type Pose } from './poses.ts'
export { ServicePlanner } from './planner.ts'
export { keepWatching, type WatchOptions } from './watch.ts'
export * as envV1 from '../gen/surefoot/world/v1/env_pb.ts'
export * as mapsV1 from '../gen/surefoot/world/v1/maps_pb.ts'
export * as plannerV1 from '../gen/surefoot/planner/v1/planner_pb.ts'
export * as worldV1 from '../gen/surefoot/world/v1/world_pb.ts'
