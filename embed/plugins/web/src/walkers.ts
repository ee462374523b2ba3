// Agents that walk to goals by plan: the loop that most pages want. For another loop, use agents and followers directly.

import { type Action, Agents } from './agents/agents.ts'
import { checkArrival, type Footing } from './agents/arrival.ts'
import type { AgentState } from './agents/observation.ts'
import type { CastRays } from './agents/rays.ts'
import { checkVec3, SurefootError } from './checks.ts'
import { Follower, type FollowerOptions } from './plans/follower.ts'
import type { Planner } from './plans/plan.ts'
import { distance, type Vec3 } from './vec3.ts'

/**
 * - idle: it has no goal
 * - walking: it is on its way
 * - arrived: it stood within the radius of its goal, with nothing solid between
 * - unreachable: no path leads to the goal, and it is as near as paths lead
 * - gave-up: it got no nearer for too long
 */
export type WalkStatus = 'idle' | 'walking' | 'arrived' | 'unreachable' | 'gave-up'

interface Walk {
  status: WalkStatus
  follower: Follower
  /** Distance from the goal within which it must stand, m. */
  radius: number
  /** Where its feet were last, m. */
  feet: Vec3 | undefined
  /** Whether it has come to its waypoint since the last decision. */
  isReached: boolean
}

/**
 * How far a place is from the goal at most to be near it: in metres, and as a share of the agent's distance from the
 * goal.
 */
const [NEAR_M, NEAR_SHARE] = [4, 0.25]
const STAND_STILL: Action = { forward: 0, strafe: 0, turn: 0, jump: 0 }

export class Walkers {
  private readonly walks: (Walk | undefined)[]
  /** Casts rays as at the last decision. */
  private castRays: CastRays | undefined

  constructor(
    readonly agents: Agents,
    private readonly planner: Planner,
    private readonly options: FollowerOptions = {},
  ) {
    this.walks = Array.from({ length: agents.count })
  }

  /**
   * Sends an agent to a place, m, where it is to stand within a radius, m. Near the goal of an agent on its way, within
   * 4 m or a quarter of its distance, the goal moves and the plan stays, so that a target that moves may be passed in
   * every frame. Elsewhere another attempt begins.
   */
  send(agent: number, place: Vec3, { radius: wanted }: { radius?: number } = {}): void {
    this.check(agent)
    const { goal, radius } = checkArrival({ goal: place, radius: wanted })
    const walk = this.walks[agent]
    if (walk?.status === 'walking' && walk.feet !== undefined && isNear(goal, walk.follower.goal, walk.feet)) {
      walk.radius = radius
      this.moveGoal(agent, walk, goal, walk.feet)
      return
    }
    const follower = new Follower(goal, this.options)
    this.walks[agent] = { status: 'walking', follower, radius, feet: undefined, isReached: false }
  }

  /** Lets an agent stand still; with another seed or body of it, call `agents.begin`. */
  stop(agent: number): void {
    this.check(agent)
    this.walks[agent] = undefined
  }

  status(agent: number): WalkStatus {
    this.check(agent)
    return this.walks[agent]?.status ?? 'idle'
  }

  /** What an agent follows; undefined if it was not sent anywhere. */
  follower(agent: number): Follower | undefined {
    this.check(agent)
    return this.walks[agent]?.follower
  }

  /**
   * Takes note of where an agent is. Call it often, such as in each tick: places that are passed in between count, and
   * goals where it stands. It casts rays as the last decision did.
   */
  note(agent: number, state: Footing): void {
    this.check(agent)
    const walk = this.walks[agent]
    if (walk?.status !== 'walking') return
    walk.feet = checkVec3('feet', state.feet)
    const { goal, waypoint } = walk.follower
    if (this.hasArrived(state, goal, walk.radius)) {
      walk.status = 'arrived'
    } else if (waypoint !== undefined) {
      const isPassed = this.agents.note(agent, walk.feet)
      // Waypoints are passed on the run or in flight, but the last one is a place to stand.
      if (walk.follower.isLastLeg ? this.hasArrived(state, waypoint) : isPassed) walk.isReached = true
    }
  }

  /**
   * Decides for agents, once every 1/6 s; those that do not walk stand still. Actions are in the agents' order.
   * @throws SurefootError if a state or a ray makes no sense, and what the planner throws; call it again at the next decision.
   */
  async decide(agents: readonly number[], states: readonly AgentState[], castRays: CastRays): Promise<Action[]> {
    if (agents.length !== states.length) {
      throw new SurefootError(`there are ${agents.length} agents, but ${states.length} states: give one for each`)
    }
    this.castRays = castRays
    agents.forEach((agent, row) => this.note(agent, states[row]!))
    await Promise.all(agents.map((agent, row) => this.follow(agent, states[row]!.feet)))
    const rows = agents.map((_, row) => row).filter((row) => this.status(agents[row]!) === 'walking')
    const walking = rows.map((row) => agents[row]!)
    const decided = await this.agents.decide(
      walking,
      rows.map((row) => states[row]!),
      castRays,
    )
    const actions = agents.map(() => STAND_STILL)
    rows.forEach((row, idx) => (actions[row] = decided[idx]!))
    return actions
  }

  /** Brings an agent's waypoint up to date. */
  private async follow(agent: number, feet: Vec3): Promise<void> {
    const walk = this.walks[agent]
    if (walk?.status !== 'walking') return
    const { follower } = walk
    let step = follower.advance(feet, walk.isReached)
    walk.isReached = false
    const goesOn = step.kind === 'keep' || step.kind === 'head'
    if (step.kind === 'plan' || (goesOn && follower.hasGoalDrifted(feet))) {
      step = await follower.makePlan(this.planner, feet)
      // It may have been sent elsewhere meanwhile.
      if (this.walks[agent] !== walk) return
    }
    if (step.kind === 'head') this.headFor(agent, walk, feet, step.waypoint)
    else if (step.kind === 'give-up') walk.status = 'gave-up'
    else if (step.kind === 'unreachable') walk.status = 'unreachable'
  }

  private moveGoal(agent: number, walk: Walk, goal: Vec3, feet: Vec3): void {
    const step = walk.follower.moveGoal(goal, feet, walk.isReached)
    if (step.kind === 'head') this.headFor(agent, walk, feet, step.waypoint)
  }

  private headFor(agent: number, walk: Walk, feet: Vec3, waypoint: Vec3): void {
    this.agents.setGoal(agent, feet, waypoint)
    walk.isReached = false
  }

  private hasArrived(state: Footing, goal: Vec3, radius?: number): boolean {
    return this.castRays !== undefined && this.agents.hasArrived(state, { goal, radius }, this.castRays)
  }

  private check(agent: number): void {
    if (Number.isInteger(agent) && agent >= 0 && agent < this.walks.length) return
    throw new SurefootError(`agent ${agent} does not exist: it must be 0 to ${this.walks.length - 1}`)
  }
}

/** Whether a place is so near the goal of an agent at `feet` that the goal moves there, m. */
function isNear(place: Vec3, goal: Vec3, feet: Vec3): boolean {
  return distance(place, goal) <= Math.max(NEAR_M, NEAR_SHARE * distance(feet, goal))
}
