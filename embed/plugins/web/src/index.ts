// Everything of the package. `surefoot/client`, `surefoot/agents` and `surefoot/plans` are its parts.

export * from './agents/index.ts'
export * from './client/index.ts'
export * from './plans/index.ts'
export { Walkers, type WalkStatus } from './walkers.ts'
