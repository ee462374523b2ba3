// Follows a plan waypoint by waypoint, and asks for another one where a leg fails: the rules of
// core/rollout/src/follow.
//
// A follower neither senses nor moves. It does not rehearse legs and does not wait for movers, as NPCs of the server do.

import { checkCount, checkVec3, SurefootError } from '../checks.ts'
import { distance, type Vec3 } from '../vec3.ts'
import { type Ability, keyOf, type LegEnds, type Plan, type Planner, type Query } from './plan.ts'

export interface FollowerOptions {
  /** Decisions without coming nearer to the waypoint that cause another plan; absent: 50. */
  replanAfter?: number
  /** Decisions without any progress that end the attempt; absent: 300. */
  patience?: number
  /** Most further plans of the attempt; absent: 16. */
  maxReplans?: number
  /** How careful plans are, 0 to 1; absent: 1. */
  caution?: number
  /** Abilities that plans do without. */
  without?: readonly Ability[]
}

/**
 * What the character does next.
 *
 * - keep: it goes on heading for its waypoint, or waits where it has none while a plan is made
 * - head: it heads for this waypoint from now on
 * - plan: call `makePlan`
 * - give-up: the attempt is over, patience or plans have run out
 * - unreachable: the attempt is over, no path leads to the goal, and the character is as near as paths lead
 */
export type Step =
  { kind: 'keep' } | { kind: 'head'; waypoint: Vec3 } | { kind: 'plan' } | { kind: 'give-up' } | { kind: 'unreachable' }

/** How a character got along an edge, as the planner service wants it reported. */
export interface Traversal {
  from: number
  to: number
  decisions: number
  reached: boolean
  died: boolean
}

type Ended = Extract<Step, { kind: 'give-up' | 'unreachable' }>

/** Legs to the goal that fail, each from another vertex, until the goal counts as unreachable. */
const MAX_FAILED_ARRIVALS = 5
/** How often legs on which there was no progress are given another chance, where no other path is left. */
const MAX_CHANCES = 3
/** Most failed legs that are kept; the oldest is dropped first. */
const MAX_FAILED_LEGS = 48
const MOST_DECISIONS = 1e6
/**
 * How far a goal moves before the character heads for its new place, and before it takes another plan: in metres, and
 * as a share of the character's distance from the goal.
 */
const [AIM_M, AIM_SHARE] = [0.5, 0.15]
const [DRIFT_M, DRIFT_SHARE] = [1, 0.25]

export class Follower {
  private readonly options: Required<FollowerOptions>
  private target: Vec3
  /** The goal for which the plan was made, m. */
  private plannedGoal: Vec3
  /** Where the character was when its goal moved and it had moved itself, m. */
  private movedFrom: Vec3
  private current: Plan | undefined
  private leg = 0
  private end: Ended | undefined
  /** Whether `makePlan` is waiting for its planner. */
  private isPlanning = false
  private readonly leastToWaypoint = new Least()
  private readonly leastToGoal = new Least()
  private decisionsOnLeg = 0
  private replans = 0
  private failedArrivals = 0
  private chances = 0
  private failedLegs: LegEnds[] = []
  private traversals: Traversal[] = []

  /** Begins an attempt at `goal`, m. */
  constructor(goal: Vec3, options: FollowerOptions = {}) {
    this.target = checkVec3('goal', goal)
    this.plannedGoal = this.movedFrom = this.target
    this.options = { replanAfter: 50, patience: 300, maxReplans: 16, caution: 1, without: [], ...options }
    for (const name of ['replanAfter', 'patience', 'maxReplans'] as const) {
      checkCount(name, this.options[name], name === 'maxReplans' ? 0 : 1, MOST_DECISIONS)
    }
  }

  /** The goal, m. */
  get goal(): Vec3 {
    return this.target
  }

  /** The plan that is followed. */
  get plan(): Plan | undefined {
    return this.current
  }

  /** Index of the waypoint that the character heads for. */
  get waypointIdx(): number {
    return this.leg
  }

  /** The waypoint that the character heads for, m. */
  get waypoint(): Vec3 | undefined {
    return this.current?.waypoints[this.leg]
  }

  /** Whether this waypoint is the last one of the plan. */
  get isLastLeg(): boolean {
    return this.current !== undefined && this.leg === this.current.waypoints.length - 1
  }

  /**
   * Moves the goal of a character at `feet`, m; `isReached` is as in `advance`. Call it whenever the target has moved,
   * instead of beginning another attempt. The plan stays, and its last leg leads to the new goal: the step is `head` if
   * that changes the waypoint. Moves of up to 0.5 m, or 15 % of the distance between feet and goal, wait until the
   * waypoint is reached. The step is `plan` without a plan, and once the goal has drifted.
   */
  moveGoal(goal: Vec3, feet: Vec3, isReached = false): Step {
    const [to, from] = [checkVec3('goal', goal), checkVec3('feet', feet)]
    if (this.end !== undefined) return this.end
    const waypoint = this.aimAt(to, from, isReached)
    if (!this.isPlanning && (this.current === undefined || this.hasGoalDrifted(from))) return { kind: 'plan' }
    return waypoint === undefined ? { kind: 'keep' } : { kind: 'head', waypoint }
  }

  /**
   * Whether the goal is so far from where it was at the last plan that a character at `feet`, m, needs another one:
   * more than 1 m, and more than 25 % of the distance between the two. Until `makePlan` is called, the follower keeps
   * its plan.
   */
  hasGoalDrifted(feet: Vec3): boolean {
    const slack = Math.max(DRIFT_M, DRIFT_SHARE * distance(feet, this.target))
    return this.current !== undefined && !this.isPlanning && distance(this.plannedGoal, this.target) > slack
  }

  /**
   * Takes note of a decision: where the feet are, m, and whether they came within 1 m of the waypoint since the last
   * one. At the last waypoint, say whether the character stands there, as `Agents.hasArrived` does.
   */
  advance(feet: Vec3, isReached: boolean): Step {
    checkVec3('feet', feet)
    if (this.end !== undefined) return this.end
    if (this.isPlanning) return { kind: 'keep' }
    const plan = this.current
    if (plan === undefined)
      return this.replans > this.options.maxReplans ? this.finish(this.outOfPatience()) : { kind: 'plan' }
    this.decisionsOnLeg += 1
    this.leastToGoal.note(distance(feet, this.target))
    if (!isReached) return this.wait(plan, feet)
    if (!this.isLastLeg) return this.headForNext(plan)
    if (plan.nearest !== undefined) {
      this.endLeg({ reached: true })
      return this.finish({ kind: 'unreachable' })
    }
    // The last waypoint may lag behind a goal that has moved a little: then the goal itself is next.
    const waypoint = this.aimAt(this.target, feet, true)
    const step = this.wait(plan, feet)
    return step.kind === 'keep' && waypoint !== undefined ? { kind: 'head', waypoint } : step
  }

  /**
   * Plans from `feet`, m, and follows that plan. A planner that takes its time is awaited; `advance` says `keep` meanwhile.
   * @throws what the planner throws; the follower then still wants a plan.
   */
  async makePlan(planner: Planner, feet: Vec3): Promise<Step> {
    if (this.end !== undefined) return this.end
    if (this.isPlanning) throw new SurefootError('a plan is being made already: await it first')
    const start = checkVec3('feet', feet)
    this.isPlanning = true
    try {
      let [plan, goal]: [Plan | undefined, Vec3] = [undefined, this.target]
      do {
        goal = this.target
        plan = await planner.findPath(this.query(start))
      } while (this.reconsiders(plan))
      const step = this.follow(plan)
      // The goal may have moved since.
      this.plannedGoal = goal
      return step
    } finally {
      this.isPlanning = false
    }
  }

  /**
   * Follows a plan that was made elsewhere for this goal; its last leg leads to the goal, unless it leads to the
   * nearest place.
   */
  follow(plan: Plan): Step {
    if (this.end !== undefined) return this.end
    if (plan.waypoints.length === 0 || plan.waypoints.length !== plan.legs.length) {
      const counts = `${plan.waypoints.length} waypoints and ${plan.legs.length} legs`
      throw new SurefootError(`the plan has ${counts}: it needs a leg to each waypoint, and at least one`)
    }
    const waypoints = plan.nearest === undefined ? [...plan.waypoints.slice(0, -1), this.target] : plan.waypoints
    this.current = { ...plan, waypoints: [...waypoints] }
    this.plannedGoal = this.target
    this.startLeg(0)
    return { kind: 'head', waypoint: waypoints[0]! }
  }

  /** The query for a plan from `start`, m, that avoids what has failed. */
  query(start: Vec3): Query {
    const { caution, without } = this.options
    return { start, goal: this.target, avoid: this.failedLegs, caution, without }
  }

  /** Drops the plan, because the level or its graph has changed; its leg does not count as failed. */
  forgetPlan(): void {
    this.current = undefined
  }

  /** Takes note that the character died, which ends the attempt. */
  noteDeath(): void {
    if (this.end !== undefined) return
    this.endLeg({ died: true })
    this.finish({ kind: 'give-up' })
  }

  /** Traversals of edges since the last call. */
  takeTraversals(): Traversal[] {
    const taken = this.traversals
    this.traversals = []
    return taken
  }

  /**
   * Moves the goal, and returns the waypoint if that changes it; small changes wait until they matter, or until the
   * waypoint is reached.
   */
  private aimAt(goal: Vec3, feet: Vec3, isReached: boolean): Vec3 | undefined {
    const far = distance(feet, goal)
    if (distance(goal, this.target) > 0) this.retarget(goal, feet, far)
    const waypoints = this.current?.nearest === undefined ? this.current?.waypoints : undefined
    if (waypoints === undefined) return undefined
    const slack = isReached ? 0 : Math.max(AIM_M, AIM_SHARE * far)
    if (distance(waypoints[waypoints.length - 1]!, goal) <= slack) return undefined
    waypoints[waypoints.length - 1] = goal
    if (!this.isLastLeg) return undefined
    this.leastToWaypoint.restart(far, this.leastToGoal.stalled)
    return goal
  }

  /** A target that runs away is no want of progress, but a character that stands still is. */
  private retarget(goal: Vec3, feet: Vec3, far: number): void {
    const isMoving = distance(feet, this.movedFrom) >= AIM_M
    this.target = goal
    this.leastToGoal.restart(far, isMoving ? 0 : this.leastToGoal.stalled)
    if (!isMoving) return
    this.movedFrom = feet
    this.replans = 0
  }

  private headForNext(plan: Plan): Step {
    this.endLeg({ reached: true })
    this.startLeg(this.leg + 1)
    this.leastToGoal.forgive()
    return { kind: 'head', waypoint: plan.waypoints[this.leg]! }
  }

  /** Lets the character go on towards its waypoint unless it has got no nearer for too long. */
  private wait(plan: Plan, feet: Vec3): Step {
    this.leastToWaypoint.note(distance(feet, plan.waypoints[this.leg]!))
    const { patience, replanAfter, maxReplans } = this.options
    if (this.leastToGoal.stalled >= patience) return this.finish(this.outOfPatience())
    if (this.leastToWaypoint.stalled < replanAfter) return { kind: 'keep' }
    if (this.replans >= maxReplans) return this.finish(this.outOfPatience())
    const { from, to } = plan.legs[this.leg]!
    this.endLeg({})
    this.replans += 1
    this.current = undefined
    return this.avoid({ from, to })
  }

  private avoid(leg: LegEnds): Step {
    const others = this.failedLegs.filter((known) => keyOf(known) !== keyOf(leg))
    this.failedLegs = [...others, leg].slice(-MAX_FAILED_LEGS)
    if (leg.to === 'goal') this.failedArrivals += 1
    return this.failedArrivals >= MAX_FAILED_ARRIVALS ? this.finish({ kind: 'unreachable' }) : { kind: 'plan' }
  }

  /** Whether to plan again instead of following a plan that leads elsewhere: legs that failed get another chance. */
  private reconsiders(plan: Plan): boolean {
    if (plan.noPath === undefined || this.chances >= MAX_CHANCES || this.failedLegs.length === 0) return false
    this.failedLegs = []
    this.chances += 1
    return true
  }

  private startLeg(leg: number): void {
    this.leg = leg
    this.leastToWaypoint.restart()
    this.decisionsOnLeg = 0
  }

  private endLeg({ reached = false, died = false }): void {
    const { from, to } = this.current?.legs[this.leg] ?? {}
    if (typeof from !== 'number' || typeof to !== 'number') return
    this.traversals.push({ from, to, decisions: this.decisionsOnLeg, reached, died })
  }

  private finish(end: Ended): Ended {
    this.end = end
    return end
  }

  /** Where every path has failed, the goal cannot be reached, as far as anyone can tell. */
  private outOfPatience(): Ended {
    return this.chances > 0 ? { kind: 'unreachable' } : { kind: 'give-up' }
  }
}

/** The least distance so far, and for how many decisions it has stayed the least. */
class Least {
  stalled = 0
  private least = Infinity

  note(metres: number): void {
    this.stalled += 1
    if (metres >= this.least) return
    this.least = metres
    this.stalled = 0
  }

  forgive(): void {
    this.stalled = 0
  }

  restart(least = Infinity, stalled = 0): void {
    this.least = least
    this.stalled = stalled
  }
}
