// Agents that walk to goals by plan: the loop that most pages want. For another loop, use agents and followers directly.

import { type Action, Agents } from './agents/agents.ts'
import { REACHED_WITHIN_M } from './agents/attempt.ts'
import type { AgentState } from './agents/observation.ts'
import type { CastRays } from './agents/rays.ts'
import { checkVec3, SurefootError } from './checks.ts'
import { Follower, type FollowerOptions } from './plans/follower.ts'
import type { Planner } from './plans/plan.ts'
import { distance, type Vec3 } from './vec3.ts'

/**
 * - idle: it has no goal
 * - walking: it is on its way
 * - arrived: it came within 1 m of its goal
 * - unreachable: no path leads to the goal, and it is as near as paths lead
 * - gave-up: it got no nearer for too long
 */
export type WalkStatus = 'idle' | 'walking' | 'arrived' | 'unreachable' | 'gave-up'

interface Walk {
  status: WalkStatus
  follower: Follower
  /** Whether it has come to its waypoint since the last decision. */
  isReached: boolean
}

const STAND_STILL: Action = { forward: 0, strafe: 0, turn: 0, jump: 0 }

export class Walkers {
  private readonly walks: (Walk | undefined)[]

  constructor(
    readonly agents: Agents,
    private readonly planner: Planner,
    private readonly options: FollowerOptions = {},
  ) {
    this.walks = Array.from({ length: agents.count })
  }

  /** Sends an agent to a place, m, wherever it was going. */
  send(agent: number, goal: Vec3): void {
    this.check(agent)
    this.walks[agent] = { status: 'walking', follower: new Follower(goal, this.options), isReached: false }
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

  /** Takes note of where an agent's feet are, m. Call it often, such as in each frame: places that are passed in between count. */
  note(agent: number, feet: Vec3): void {
    this.check(agent)
    const walk = this.walks[agent]
    if (walk?.status !== 'walking') return
    const { goal, waypoint } = walk.follower
    if (distance(checkVec3('feet', feet), goal) <= REACHED_WITHIN_M) walk.status = 'arrived'
    else if (waypoint !== undefined && this.agents.note(agent, feet)) walk.isReached = true
  }

  /**
   * Decides for agents, once every 1/6 s; those that do not walk stand still. Actions are in the agents' order.
   * @throws SurefootError if a state or a ray makes no sense, and what the planner throws; call it again at the next decision.
   */
  async decide(agents: readonly number[], states: readonly AgentState[], castRays: CastRays): Promise<Action[]> {
    if (agents.length !== states.length) {
      throw new SurefootError(`there are ${agents.length} agents, but ${states.length} states: give one for each`)
    }
    agents.forEach((agent, row) => this.note(agent, states[row]!.feet))
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
    let step = walk.follower.advance(feet, walk.isReached)
    walk.isReached = false
    if (step.kind === 'plan') step = await walk.follower.makePlan(this.planner, feet)
    if (step.kind === 'head') this.agents.setGoal(agent, feet, step.waypoint)
    else if (step.kind === 'give-up') walk.status = 'gave-up'
    else if (step.kind === 'unreachable') walk.status = 'unreachable'
  }

  private check(agent: number): void {
    if (Number.isInteger(agent) && agent >= 0 && agent < this.walks.length) return
    throw new SurefootError(`agent ${agent} does not exist: it must be 0 to ${this.walks.length - 1}`)
  }
}
