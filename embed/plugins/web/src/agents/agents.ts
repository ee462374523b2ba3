// Agents: what characters of the page sense, want and remember. Those of one kind share a policy and decide in batches.

import { checkCount, checkRange, checkVec3, SurefootError } from '../checks.ts'
import { type Vec3, ZERO } from '../vec3.ts'
import { type Arrival, type Footing, hasArrived } from './arrival.ts'
import { Attempt } from './attempt.ts'
import { type Body, bodyOf } from './body.ts'
import { type Devices, type PlacedDevices, placeDevices } from './devices.ts'
import { Noise } from './noise.ts'
import { type AgentState, checkState, type LastDecision, NO_DECISION, OBSERVATION_LEN, observe } from './observation.ts'
import { ACTION_LEN, type Decided, type Policy } from './policy.ts'
import { type CastRays, checkHits, RAY_COUNT, writeRays } from './rays.ts'

/** The controls of a character until its next decision, each -1 to 1. */
export interface Action {
  /** Moves forward (positive) or backward, as a share of the top speed. */
  forward: number
  /** Moves to the right (positive) or to the left. */
  strafe: number
  /** Turns to the left (positive: yaw grows) or to the right, as a share of the top turning speed. */
  turn: number
  /** Jumps once if positive, from the ground or again in the air. */
  jump: number
}

/** Seconds from one decision to the next. */
export const DECISION_SECONDS = 1 / 6
/** Share of its exploration noise with which a policy does best: some noise frees characters where the mean runs in circles. */
export const DEFAULT_NOISE_SHARE = 0.5
const MOST_AGENTS = 65_536

export interface AgentOptions {
  /** Number of agents; absent: 1. */
  count?: number
  /** What differs from the default body. */
  body?: Partial<Body>
  /** The level's jump pads, zip lines, teleporters and jetpacks. */
  devices?: Devices
  /** Share of the policy's exploration noise, 0 to 1; absent: `DEFAULT_NOISE_SHARE`. */
  noiseShare?: number
}

/** What one agent wants and remembers. */
interface Mind {
  attempt: Attempt | undefined
  last: LastDecision
  /** Velocity at the last observation, m/s. */
  velocity: Vec3
  /** The attempt that its last decision was part of, until the next observation. */
  decidedFor: Attempt | undefined
  /** Whether a decision of it is under way. */
  isDeciding: boolean
  noise: Noise
  /** What the policy remembers. */
  memory: Float32Array
}

export class Agents {
  readonly body: Body
  private devices: PlacedDevices
  private readonly noiseShare: number
  private readonly minds: Mind[]

  constructor(
    private readonly policy: Policy,
    { count = 1, body, devices = {}, noiseShare = DEFAULT_NOISE_SHARE }: AgentOptions = {},
  ) {
    this.body = bodyOf(body)
    this.devices = placeDevices(devices)
    this.noiseShare = checkRange('noiseShare', noiseShare, 0, 1)
    checkCount('count', count, 1, MOST_AGENTS)
    this.minds = Array.from({ length: count }, (_, agent) => this.newMind(agent))
  }

  get count(): number {
    return this.minds.length
  }

  /** Replaces the devices that agents see. */
  setDevices(devices: Devices): void {
    this.devices = placeDevices(devices)
  }

  /** Makes an agent forget all, when its character is spawned or put elsewhere. `seed` decides its noise. */
  begin(agent: number, seed: number = agent): void {
    this.mindOf(agent)
    this.minds[agent] = this.newMind(seed)
  }

  /** Gives an agent at `feet` another goal or the next waypoint, between decisions, also in every one: places, m. */
  setGoal(agent: number, feet: Vec3, goal: Vec3): void {
    const mind = this.mindOf(agent)
    mind.attempt = new Attempt(checkVec3('goal', goal), checkVec3('feet', feet))
  }

  /**
   * Takes note of where an agent is between decisions, and returns whether it has come within 1 m of its goal, also in
   * flight.
   */
  note(agent: number, feet: Vec3): boolean {
    const attempt = this.attemptOf(agent)
    attempt.note(checkVec3('feet', feet))
    return attempt.isReached
  }

  /**
   * Whether a character has arrived at a goal, as NPCs of the server arrive: it stands within the radius, no higher or
   * lower than steps and slopes take it, and nothing solid is between. Ask in each tick.
   */
  hasArrived(state: Footing, arrival: Arrival, castRays: CastRays): boolean {
    return hasArrived(this.body, state, arrival, castRays)
  }

  /** Decisions in a row during which an agent came no nearer to its goal; it is hopeless from `PATIENCE` on. */
  stalledDecisions(agent: number): number {
    return this.attemptOf(agent).stalledDecisions
  }

  /** Takes note that an agent's character does something else than it decided. */
  acted(agent: number, { forward, strafe, turn, jump }: Action): void {
    const check = (name: keyof Action, value: number) => checkRange(`action.${name}`, value, -1, 1)
    const action = [check('forward', forward), check('strafe', strafe), check('turn', turn), check('jump', jump)]
    this.mindOf(agent).last.action = action as [number, number, number, number]
  }

  /**
   * Observes and decides for some agents, once every 1/6 s. Actions are in the agents' order; hold them until the next decision.
   * @throws SurefootError if an agent has no goal or decides already, or a state or a ray makes no sense. No agent has changed then.
   */
  async decide(agents: readonly number[], states: readonly AgentState[], castRays: CastRays): Promise<Action[]> {
    if (agents.length === 0) return []
    const observations = this.observe(agents, states, castRays)
    const minds = agents.map((agent) => this.mindOf(agent))
    const memoryLen = 2 * this.policy.memoryLen
    const memories = new Float32Array(agents.length * memoryLen)
    minds.forEach((mind, row) => memories.set(mind.memory, row * memoryLen))
    // Goals may be set while the policy runs.
    const attempts = minds.map(({ attempt }) => attempt)
    for (const mind of minds) mind.isDeciding = true
    try {
      const decided = await this.policy.run(observations, memories)
      return minds.map((mind, row) => {
        mind.decidedFor = attempts[row]
        return this.take(mind, row, decided)
      })
    } finally {
      for (const mind of minds) mind.isDeciding = false
    }
  }

  /** The observations of some agents: 369 values each, one after another. `decide` calls this by itself. */
  observe(agents: readonly number[], states: readonly AgentState[], castRays: CastRays): Float32Array {
    this.check(agents, states)
    const rayCount = agents.length * RAY_COUNT
    const [origins, directions] = [new Float32Array(rayCount * 3), new Float32Array(rayCount * 3)]
    states.forEach((state, row) => writeRays(this.body, state, row, origins, directions))
    const hits = castRays(origins, directions)
    checkHits(hits, rayCount)
    const observations = new Float32Array(agents.length * OBSERVATION_LEN)
    agents.forEach((agent, row) => {
      const state = states[row]!
      const { mind, attempt } = this.prepare(agent, state)
      const situation = { body: this.body, devices: this.devices, state, attempt, last: mind.last }
      const [from, to] = [row * OBSERVATION_LEN, (row + 1) * OBSERVATION_LEN]
      observe(observations.subarray(from, to), hits, row * RAY_COUNT, situation)
    })
    return observations
  }

  private check(agents: readonly number[], states: readonly AgentState[]): void {
    if (agents.length !== states.length) {
      throw new SurefootError(`there are ${agents.length} agents, but ${states.length} states: give one for each`)
    }
    if (new Set(agents).size !== agents.length) throw new SurefootError('an agent decides twice: name each once')
    agents.forEach((agent, row) => {
      this.attemptOf(agent)
      if (this.mindOf(agent).isDeciding) {
        throw new SurefootError(`agent ${agent} is still deciding: await its last decision first`)
      }
      checkState(`states[${row}]`, states[row]!)
    })
  }

  /** Brings an agent's memory up to the moment of an observation. */
  private prepare(agent: number, { feet, velocity }: AgentState): { mind: Mind; attempt: Attempt } {
    const [mind, attempt] = [this.mindOf(agent), this.attemptOf(agent)]
    attempt.note(feet)
    if (mind.decidedFor === attempt) attempt.closeDecision()
    mind.decidedFor = undefined
    mind.velocity = { x: velocity.x, y: velocity.y, z: velocity.z }
    return { mind, attempt }
  }

  /** Draws an agent's action, and keeps what it remembers of this decision. */
  private take(mind: Mind, row: number, { means, logStds, memories }: Decided): Action {
    const drawn = Array.from({ length: ACTION_LEN }, (_, idx) => {
      const at = row * ACTION_LEN + idx
      const noise = this.noiseShare === 0 ? 0 : this.noiseShare * mind.noise.gaussian() * Math.exp(logStds[at]!)
      return Math.tanh(means[at]! + noise)
    })
    const [forward, strafe, turn, jump] = drawn as [number, number, number, number]
    mind.memory = memories.slice(row * mind.memory.length, (row + 1) * mind.memory.length)
    mind.last = { velocity: mind.velocity, action: [forward, strafe, turn, jump] }
    return { forward, strafe, turn, jump }
  }

  private newMind(seed: number): Mind {
    return {
      attempt: undefined,
      last: { ...NO_DECISION },
      velocity: ZERO,
      decidedFor: undefined,
      isDeciding: false,
      noise: new Noise(checkCount('seed', seed, 0, 2 ** 32 - 1)),
      memory: new Float32Array(2 * this.policy.memoryLen),
    }
  }

  private mindOf(agent: number): Mind {
    return this.minds[checkCount('agent', agent, 0, this.minds.length - 1)]!
  }

  private attemptOf(agent: number): Attempt {
    const { attempt } = this.mindOf(agent)
    if (attempt === undefined) throw new SurefootError(`agent ${agent} has no goal: call setGoal first`)
    return attempt
  }
}
