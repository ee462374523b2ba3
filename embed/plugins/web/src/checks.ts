// Checks of what callers give: numbers are used as they are, or an error names them and says what to change.

import type { Vec3 } from './vec3.ts'

/** Largest coordinate, m, or speed, m/s. */
const MOST = 1.0e6

/** What a caller gave cannot be used; the message names it and says what to change. */
export class SurefootError extends Error {
  override name = 'SurefootError'
}

/** Returns a number that lies in a range; a NaN lies in none. */
export function checkRange(name: string, value: unknown, least: number, most: number): number {
  if (typeof value === 'number' && value >= least && value <= most) return value
  throw new SurefootError(`${name} is ${String(value)}, but must be a number from ${least} to ${most}`)
}

/** Returns a whole number that lies in a range. */
export function checkCount(name: string, value: unknown, least: number, most: number): number {
  if (Number.isInteger(value)) return checkRange(name, value, least, most)
  throw new SurefootError(`${name} is ${String(value)}, but must be a whole number from ${least} to ${most}`)
}

/** Returns a copy of a vector whose values are finite and within reason. */
export function checkVec3(name: string, value: Vec3): Vec3 {
  const { x, y, z } = value ?? {}
  if ([x, y, z].every((part) => typeof part === 'number' && Math.abs(part) <= MOST)) return { x, y, z }
  throw new SurefootError(`${name} is (${x}, ${y}, ${z}): x, y and z must be finite numbers, and at most a million`)
}

/** Refuses an array that has another length than it needs. */
export function checkLength(name: string, values: ArrayLike<unknown>, length: number): void {
  if (values?.length === length) return
  throw new SurefootError(`${name} has ${values?.length ?? 'no'} values, but must have ${length}`)
}
