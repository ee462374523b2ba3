// How a character moves, as an animation needs it: the rules that servers apply to their NPCs.

import type { Action } from './agents.ts'
import type { Body } from './body.ts'
import type { AgentState } from './observation.ts'

/**
 * What the legs of a character do; in the air, what they did last.
 * - turn: it turns in place
 * - walk: its Froude number is at most 0.5, up to 2.2 m/s for a body of 1.8 m
 * - stop: it moves, but its action brings it to rest
 */
export type Pace = 'idle' | 'turn' | 'walk' | 'run' | 'stop'

/**
 * Phase of a leap, a ride or a fall.
 * - landing: it has come down within the last 0.2 s
 */
export type MovePhase = 'none' | 'flight' | 'landing'

/** Height of the hip as a share of the body's height (Winter 2009), and the gravity for which strides hold, m/s2. */
const [HIP_SHARE, GRAVITY] = [0.53, 9.81]
/** Froude number at which walking turns into running (Alexander 1989). */
const RUN_FROUDE = 0.5
/** Shares of the speed at which it begins to run, and of its greatest turn, up to which a body stands. */
const [IDLE_SHARE, TURN_SHARE] = [0.1, 0.05]
/** Least ticks of a fall without a jump, and ticks of a landing. */
const [MIN_FALL_TICKS, LANDING_TICKS] = [6, 12]
const TICK_SECONDS = 1 / 60
/** Share of a step's offset by which it decays in a tick, and the offset that is dropped, m. */
const [DECAY, LEAST_OFFSET_M] = [1 - Math.exp(-TICK_SECONDS / 0.1), 0.001]
/** Steepest slope on which a character rises or sinks smoothly, as a tangent. */
const STEEPEST = 2

export class Locomotion {
  pace: Pace = 'idle'
  phase: MovePhase = 'none'
  /** Length of a stride, which is two steps, m; 0 unless the character moves on the ground. */
  strideM = 0
  /** Share of the stride done, 0 to 1: one foot is put down at 0, the other at 0.5. */
  stridePhase = 0
  /**
   * Height to add to the drawn character, m, so that its height changes smoothly over steps: up to the body's step
   * height, and negative after a step up. It decays with a time constant of 0.1 s, or as fast as the character moves.
   * 0 on rides and after a teleport.
   */
  stepOffsetM = 0
  /** Ticks in the air, or since the landing. */
  private ticks = 0
  private wasThrown = false
  /** The feet at the last tick: their height, m, how much they rose, m, and whether they stood on ground. */
  private feetM = 0
  private riseM = 0
  private wasGrounded = false

  constructor(private readonly body: Body) {}

  /** Follows the character by one tick of 1/60 s, in which it carried out an action and came to a state. */
  advance(state: AgentState, action: Action): void {
    this.advancePhase(state, action)
    this.advanceSteps(state)
    if (!state.isGrounded) {
      this.strideM = 0
      return
    }
    const speed = Math.hypot(state.velocity.x, state.velocity.z)
    this.pace = this.paceAt(speed, action)
    if (this.pace === 'idle' || this.pace === 'turn') {
      ;[this.strideM, this.stridePhase] = [0, 0]
      return
    }
    // Alexander, Nature 261, 1976.
    this.strideM = 2.3 * this.hipM * ((speed * speed) / (GRAVITY * this.hipM)) ** 0.3
    this.stridePhase = (this.stridePhase + (speed * TICK_SECONDS) / this.strideM) % 1
  }

  private get hipM(): number {
    return HIP_SHARE * this.body.height
  }

  private advancePhase({ isGrounded, isRiding, velocity }: AgentState, { jump }: Action): void {
    if (isGrounded) {
      const isLanding = this.phase === 'flight' || (this.phase === 'landing' && this.ticks < LANDING_TICKS)
      this.ticks = this.phase === 'landing' && isLanding ? this.ticks + 1 : 0
      this.phase = isLanding ? 'landing' : 'none'
      this.wasThrown = false
      return
    }
    if (this.phase === 'landing') [this.phase, this.ticks] = ['none', 0]
    this.ticks += 1
    this.wasThrown ||= isRiding === true || (jump > 0 && velocity.y > 0)
    if (this.wasThrown || this.ticks >= MIN_FALL_TICKS) this.phase = 'flight'
  }

  /** Slopes and lifts raise a character by about as much in each tick; only the rest is a step. */
  private advanceSteps({ feet, velocity, isGrounded, isRiding }: AgentState): void {
    const most = this.body.stepHeight
    const rise = this.wasGrounded && isGrounded ? feet.y - this.feetM : 0
    const way = Math.hypot(velocity.x, velocity.z) * TICK_SECONDS
    const farthest = most + STEEPEST * way
    const isCarried = isRiding === true || Math.abs(rise) > farthest
    const steady = rise * this.riseM > 0 ? Math.sign(rise) * Math.min(Math.abs(rise), Math.abs(this.riseM)) : 0
    const offset = Math.min(Math.max(this.stepOffsetM - (rise - steady), -most), most)
    const left = Math.abs(offset) - Math.max(way, DECAY * Math.abs(offset))
    this.stepOffsetM = isCarried || left < LEAST_OFFSET_M ? 0 : Math.sign(offset) * left
    ;[this.feetM, this.riseM, this.wasGrounded] = [feet.y, isCarried ? 0 : rise, isGrounded]
  }

  private paceAt(speed: number, { forward, strafe, turn }: Action): Pace {
    const { forwardSpeed, sideSpeedShare } = this.body
    const run = Math.sqrt(RUN_FROUDE * GRAVITY * this.hipM)
    if (speed <= IDLE_SHARE * run) return Math.abs(turn) > TURN_SHARE ? 'turn' : 'idle'
    const wish = Math.min(Math.hypot(Math.max(forward, -sideSpeedShare), strafe * sideSpeedShare), 1) * forwardSpeed
    if (wish <= IDLE_SHARE * run) return 'stop'
    return speed <= run ? 'walk' : 'run'
  }
}
