// Plans: waypoints in order and the legs that lead to them.

import { checkRange, checkVec3, SurefootError } from '../checks.ts'
import type { Vec3 } from '../vec3.ts'

/** What a character must be able to do on a leg, the least demanding first. */
export const ABILITIES = [
  'walk',
  'jump',
  'double_jump',
  'pad',
  'zip_line',
  'teleporter',
  'jetpack',
  'climb',
  'mantle',
  'swim',
  'crouch',
  'dash',
] as const
export type Ability = (typeof ABILITIES)[number]

/** Where a leg begins or ends: an end of the query, or the index of a vertex. */
export type Stop = 'start' | 'goal' | number

/** The two ends of a leg. */
export interface LegEnds {
  from: Stop
  to: Stop
}

export interface Leg extends LegEnds {
  /** Expected duration, what failures cost included, s. */
  seconds: number
  /** Estimated chance of success, 0 to 1. */
  chance: number
  /** Estimated chance of dying on it, at most 1 - chance. */
  deathChance: number
  /** The most demanding ability that it takes. */
  ability: Ability
}

/**
 * Why there is no path.
 *
 * - start-off-graph, goal-off-graph: no vertex near that end has edges
 * - different-islands: no path joins the two in either direction
 * - one-way: a path leads only from the goal to the start
 * - goal-in-zone: the goal is in a zone that the plan must not enter
 */
export type NoPath = 'start-off-graph' | 'goal-off-graph' | 'different-islands' | 'one-way' | 'goal-in-zone'

/** The answer to a query. No path is an answer as well: the waypoints then lead as near to the goal as paths do. */
export interface Plan {
  /** Places, m; leg `i` ends at waypoint `i`. There is at least one. */
  waypoints: Vec3[]
  legs: Leg[]
  /** Absent: there is a path. */
  noPath?: NoPath
  /** Without a path: the reachable vertex nearest to the goal, m. Absent as well: the plan is one leg straight to the goal. */
  nearest?: Vec3
}

export interface Query {
  start: Vec3
  goal: Vec3
  /** Legs that the plan must not use. */
  avoid?: readonly LegEnds[]
  /** Abilities that the plan does without; without jumps it does without double jumps, too. */
  without?: readonly Ability[]
  /** How much the plan does to avoid that the character dies, from 0 (bold) to 1 (careful); absent: 1. */
  caution?: number
}

/** A source of plans: a graph in the page, or the planner service. */
export interface Planner {
  findPath(query: Query): Plan | Promise<Plan>
}

/** A query without gaps, and with sets in place of lists. */
export interface CheckedQuery {
  start: Vec3
  goal: Vec3
  /** Keys of legs, see `keyOf`. */
  avoid: Set<string>
  without: Set<Ability>
  caution: number
}

/** The name of a leg, for sets. */
export function keyOf({ from, to }: LegEnds): string {
  return `${from}>${to}`
}

/**
 * Completes a query.
 * @throws SurefootError that names the first value which cannot be used.
 */
export function checkQuery({ start, goal, avoid = [], without = [], caution = 1 }: Query): CheckedQuery {
  const unknown = without.find((ability) => !ABILITIES.includes(ability) || ability === 'walk')
  if (unknown !== undefined) {
    throw new SurefootError(`query.without has ${unknown}, but may have only ${ABILITIES.slice(1).join(', ')}`)
  }
  const withoutDoubles: Ability[] = without.includes('jump') ? ['double_jump'] : []
  return {
    start: checkVec3('query.start', start),
    goal: checkVec3('query.goal', goal),
    avoid: new Set(avoid.map(keyOf)),
    without: new Set([...without, ...withoutDoubles]),
    caution: checkRange('query.caution', caution, 0, 1),
  }
}

/** Estimated chance that every leg of a plan succeeds. */
export function chanceOf({ legs }: Plan): number {
  return legs.reduce((chance, leg) => chance * leg.chance, 1)
}

/** Expected duration of a plan, what failures cost included, s. */
export function secondsOf({ legs }: Plan): number {
  return legs.reduce((seconds, leg) => seconds + leg.seconds, 0)
}
