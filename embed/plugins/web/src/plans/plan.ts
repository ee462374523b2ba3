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
  'wall_run',
  'slide',
  'dive',
] as const
/** One of `ABILITIES`, or the name of one of the body's own moves. */
export type Ability = (typeof ABILITIES)[number] | (string & {})

/** Number of the first of a body's own moves in messages; those of other abilities count from 1. */
const FIRST_OWN = 17

/** The number of an ability in messages; `undefined` if a body with these own moves has none of that name. */
export function numberOf(ability: Ability, moves: readonly string[] = []): number | undefined {
  const idx = (ABILITIES as readonly string[]).indexOf(ability)
  if (idx >= 0) return idx + 1
  const own = moves.indexOf(ability)
  return own >= 0 ? FIRST_OWN + own : undefined
}

/** The name of an ability with a number in messages. */
export function abilityOf(number: number, moves: readonly string[] = []): Ability {
  return (number >= FIRST_OWN ? moves[number - FIRST_OWN] : ABILITIES[number - 1]) ?? 'walk'
}

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
 * Completes a query; `moves` are the names of the body's own moves.
 * @throws SurefootError that names the first value which cannot be used.
 */
export function checkQuery(query: Query, moves: readonly string[] = []): CheckedQuery {
  const { start, goal, avoid = [], without = [], caution = 1 } = query
  const unknown = without.find((ability) => numberOf(ability, moves) === undefined || ability === 'walk')
  if (unknown !== undefined) {
    const names = [...ABILITIES.slice(1), ...moves].join(', ')
    throw new SurefootError(`query.without has ${unknown}, but may have only ${names}`)
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
