// An attempt at a goal: how near an agent has come, and how much of its patience it has used.

import { distance, type Vec3 } from '../vec3.ts'

/** Distance from a goal or waypoint within which it counts as reached, m. */
export const REACHED_WITHIN_M = 1
/** Decisions without progress after which an attempt is hopeless. */
export const PATIENCE = 300

export class Attempt {
  isReached = false
  /** Decisions in a row during which the agent came no nearer. */
  stalledDecisions = 0
  private bestDistance: number
  private hasProgressed = false

  constructor(
    readonly goal: Vec3,
    feet: Vec3,
  ) {
    this.bestDistance = distance(feet, goal)
  }

  /** Takes note of where the feet are. */
  note(feet: Vec3): void {
    const far = distance(feet, this.goal)
    if (far < this.bestDistance) {
      this.bestDistance = far
      this.hasProgressed = true
    }
    if (far <= REACHED_WITHIN_M) this.isReached = true
  }

  /** Takes note that a decision is over. */
  closeDecision(): void {
    this.stalledDecisions = this.hasProgressed ? 0 : this.stalledDecisions + 1
    this.hasProgressed = false
  }

  /** Share of the patience used, 0 to 1. */
  get patienceUsed(): number {
    return Math.min(this.stalledDecisions / PATIENCE, 1)
  }
}
