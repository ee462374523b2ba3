// The planner service as a planner of the page: plans and traversals in its messages and in ours.

import type { Client } from '@connectrpc/connect'
import {
  type LegEnds as LegEndsMessage,
  NoPath as NoPathCode,
  type Plan as PlanMessage,
} from '../gen/surefoot/planner/v1/planner_pb.ts'
import { PlannerService, QueryEnd } from '../gen/surefoot/planner/v1/planner_pb.ts'
import { checkVec3, SurefootError } from '../checks.ts'
import type { Traversal } from '../plans/follower.ts'
import {
  abilityOf,
  checkQuery,
  type LegEnds,
  type NoPath,
  numberOf,
  type Plan,
  type Planner,
  type Query,
  type Stop,
} from '../plans/plan.ts'
import { add, subtract, type Vec3, ZERO } from '../vec3.ts'

const NO_PATHS: Partial<Record<NoPathCode, NoPath>> = {
  [NoPathCode.START_OFF_GRAPH]: 'start-off-graph',
  [NoPathCode.GOAL_OFF_GRAPH]: 'goal-off-graph',
  [NoPathCode.DIFFERENT_ISLANDS]: 'different-islands',
  [NoPathCode.ONE_WAY]: 'one-way',
  [NoPathCode.GOAL_IN_ZONE]: 'goal-in-zone',
}

/** Most legs that a query can avoid. */
const MOST_AVOIDED = 64
/** Time after which a plan is not waited for any longer. */
const TIMEOUT_MS = 5000

/**
 * Plans on one graph of the planner service. `origin` is where the origin of the page's level lies on the graph's map, m, as an import
 * returns it, and `moves` are the names of the body's own moves.
 */
export class ServicePlanner implements Planner {
  private readonly origin: Vec3

  constructor(
    private readonly service: Client<typeof PlannerService>,
    readonly graphId: string,
    origin: Vec3 = ZERO,
    private readonly moves: readonly string[] = [],
  ) {
    this.origin = checkVec3('origin', origin)
  }

  async findPath(query: Query): Promise<Plan> {
    const { start, goal, without, caution } = checkQuery(query, this.moves)
    const avoid = (query.avoid ?? [])
      .slice(-MOST_AVOIDED)
      .map(({ from, to }) => ({ from: stopTo(from), to: stopTo(to) }))
    const [from, to] = [add(start, this.origin), add(goal, this.origin)]
    const asked = {
      start: from,
      goal: to,
      caution,
      avoid,
      without: [...without].map((ability) => numberOf(ability, this.moves) ?? 0),
    }
    const { plan } = await this.service.findPath({ graphId: this.graphId, query: asked }, { timeoutMs: TIMEOUT_MS })
    if (plan === undefined) throw new SurefootError('the planner answered without a plan: is it another version?')
    return planFrom(plan, this.origin, this.moves)
  }

  /** Reports how characters fared along edges, so that plans avoid those that fail. Returns how many were counted. */
  async report(traversals: Traversal[]): Promise<number> {
    const { accepted } = await this.service.reportTraversals({ graphId: this.graphId, traversals })
    return accepted
  }
}

function planFrom(
  { waypoints, legs, reason, found, nearestReachable }: PlanMessage,
  origin: Vec3,
  moves: readonly string[],
): Plan {
  const noPath = found ? undefined : (NO_PATHS[reason] ?? 'different-islands')
  return {
    waypoints: waypoints.map((place) => subtract(place, origin)),
    legs: legs.map((leg) => ({
      ...endsFrom(leg),
      seconds: leg.seconds,
      chance: leg.chance,
      deathChance: leg.deathChance,
      ability: abilityOf(leg.ability, moves),
    })),
    ...(noPath !== undefined && { noPath }),
    ...(nearestReachable !== undefined && { nearest: subtract(nearestReachable, origin) }),
  }
}

function endsFrom({ from, to }: Pick<LegEndsMessage, 'from' | 'to'>): LegEnds {
  return { from: stopFrom(from), to: stopFrom(to) }
}

function stopFrom(stop: LegEndsMessage['from']): Stop {
  if (stop?.stop.case === 'vertex') return stop.stop.value
  return stop?.stop.value === QueryEnd.START ? 'start' : 'goal'
}

function stopTo(stop: Stop) {
  if (typeof stop === 'number') return { stop: { case: 'vertex', value: stop } } as const
  return { stop: { case: 'end', value: stop === 'start' ? QueryEnd.START : QueryEnd.GOAL } } as const
}
