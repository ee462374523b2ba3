// Other ways to a goal: the best plan with one of its legs left out, for each of the legs that are worth it.

import { create } from '@bufbuild/protobuf'
import {
  type Leg,
  type PathQuery,
  PathQuerySchema,
  type Plan,
  type Stop,
} from '../../gen/surefoot/planner/v1/planner_pb'
import type { Place } from '../../view/viewport.types'

/** Most queries for alternatives. */
const MAX_QUERIES = 24
/** Most alternatives beside the best plan. */
const MAX_ALTERNATIVES = 3

/** The two vertices of a leg that is an edge of the graph. */
export function edgeOf(leg: Pick<Leg, 'from' | 'to'>): { from: number; to: number } | undefined {
  const [from, to] = [vertexOf(leg.from), vertexOf(leg.to)]
  return from === undefined || to === undefined ? undefined : { from, to }
}

function vertexOf(stop: Stop | undefined): number | undefined {
  return stop?.stop.case === 'vertex' ? stop.stop.value : undefined
}

/** The legs to leave out, one a query: the least certain first. */
export function legsToAvoid(best: Plan): Leg[] {
  return best.legs
    .filter((leg) => edgeOf(leg) !== undefined)
    .sort((a, b) => a.chance - b.chance)
    .slice(0, MAX_QUERIES)
}

export function alternativeQueries(
  query: { start: Place; goal: Place; caution: number; movers: PathQuery['movers'] },
  best: Plan,
): PathQuery[] {
  return legsToAvoid(best).map((leg) => create(PathQuerySchema, { ...query, avoid: [{ from: leg.from, to: leg.to }] }))
}

/** Tells plans with the same legs. */
export function legKey(plan: Plan): string {
  return plan.legs.map(({ from, to }) => `${stopKey(from)}>${stopKey(to)}`).join(' ')
}

function stopKey(stop: Stop | undefined): string {
  return `${stop?.stop.case} ${stop?.stop.value}`
}

/** The alternatives worth showing: found, different from one another and from the best, the quickest first. */
export function pickAlternatives(best: Plan, answers: readonly Plan[]): Plan[] {
  const seen = new Set([legKey(best)])
  return answers
    .filter((plan) => {
      const key = legKey(plan)
      if (!plan.found || seen.has(key)) return false
      seen.add(key)
      return true
    })
    .sort((a, b) => a.seconds - b.seconds)
    .slice(0, MAX_ALTERNATIVES)
}

/** Where a leg begins and ends: leg i ends at waypoint i, and begins where the one before it ended. */
export function legEnds(plan: Plan, index: number, start: Place): { from: Place; to: Place } {
  const from = index === 0 ? start : (plan.waypoints[index - 1] ?? start)
  return { from, to: plan.waypoints[index] ?? from }
}
