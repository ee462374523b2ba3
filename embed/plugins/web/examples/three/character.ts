// The page's own character: an upright cylinder among boxes. A page with a physics engine has such a thing already; what matters is that
// it does what actions say, at speeds and accelerations that the body of its agent tells.

import type { Action, AgentState, Body, Vec3 } from '../../dist/index.js'
import type { Box } from './level.ts'

export const TICK_SECONDS = 1 / 60
/** Overlap that counts as touching, m. */
const SKIN = 1e-4

export class Character {
  readonly feet: Vec3
  private readonly velocity: Vec3 = { x: 0, y: 0, z: 0 }
  private yaw = 0
  private isGrounded = false
  private jumpsLeft = 0
  private isJumpPending = false

  constructor(
    private readonly body: Body,
    private readonly boxes: readonly Box[],
    start: Vec3,
  ) {
    this.feet = { ...start }
  }

  /** State of the body, for its agent. */
  get state(): AgentState {
    const { feet, velocity, yaw, isGrounded } = this
    return { feet: { ...feet }, velocity: { ...velocity }, yaw, isGrounded, canJump: isGrounded || this.jumpsLeft > 0 }
  }

  /** Begins a decision: its jump is made once. */
  begin({ jump }: Action): void {
    this.isJumpPending = jump > 0
  }

  /** Moves for 1/60 s. */
  tick({ forward, strafe, turn }: Action): void {
    this.yaw += turn * this.body.turnSpeed * TICK_SECONDS
    this.accelerate(forward, strafe)
    this.jump()
    this.moveUpright()
    this.moveAside('x')
    this.moveAside('z')
  }

  private accelerate(forward: number, strafe: number): void {
    const { forwardSpeed, sideSpeedShare, groundAcceleration, airAcceleration, gravity } = this.body
    const [sin, cos] = [Math.sin(this.yaw), Math.cos(this.yaw)]
    const [ahead, right] = [Math.max(forward, -sideSpeedShare), strafe * sideSpeedShare]
    const wish = { x: sin * ahead - cos * right, z: cos * ahead + sin * right }
    const speed = forwardSpeed / Math.max(Math.hypot(wish.x, wish.z), 1)
    const change = { x: wish.x * speed - this.velocity.x, z: wish.z * speed - this.velocity.z }
    const most = (this.isGrounded ? groundAcceleration : airAcceleration) * TICK_SECONDS
    const share = Math.min(most / Math.max(Math.hypot(change.x, change.z), SKIN), 1)
    this.velocity.x += change.x * share
    this.velocity.z += change.z * share
    this.velocity.y -= gravity * TICK_SECONDS
  }

  private jump(): void {
    if (!this.isJumpPending || !(this.isGrounded || this.jumpsLeft > 0)) return
    if (!this.isGrounded) this.jumpsLeft -= 1
    this.velocity.y = this.body.jumpSpeed
    this.isJumpPending = false
  }

  /** Moves up or down, onto the tops of boxes and against their bottoms. */
  private moveUpright(): void {
    const [before, after] = [this.feet.y, this.feet.y + this.velocity.y * TICK_SECONDS]
    this.feet.y = after
    this.isGrounded = false
    for (const { low, high } of this.boxes.filter((box) => this.isOver(box))) {
      if (before >= high[1] - SKIN && after <= high[1]) {
        this.feet.y = high[1]
        this.isGrounded = true
      } else if (before + this.body.height <= low[1] + SKIN && after + this.body.height > low[1]) {
        this.feet.y = low[1] - this.body.height
      } else continue
      this.velocity.y = 0
    }
    if (this.isGrounded) this.jumpsLeft = this.body.extraJumps
  }

  /** Moves along one axis, and stays where that leads into a box. */
  private moveAside(axis: 'x' | 'z'): void {
    const before = this.feet[axis]
    this.feet[axis] += this.velocity[axis] * TICK_SECONDS
    const isBeside = ({ low, high }: Box) =>
      this.feet.y < high[1] - SKIN && this.feet.y + this.body.height > low[1] + SKIN
    if (!this.boxes.some((box) => isBeside(box) && this.isOver(box))) return
    this.feet[axis] = before
    this.velocity[axis] = 0
  }

  /** Whether the character and a box overlap seen from above. */
  private isOver({ low, high }: Box): boolean {
    const { x, z } = this.feet
    const [dx, dz] = [x - Math.min(Math.max(x, low[0]), high[0]), z - Math.min(Math.max(z, low[2]), high[2])]
    return Math.hypot(dx, dz) < this.body.radius
  }
}
