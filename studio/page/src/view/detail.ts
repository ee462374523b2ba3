// Asks for finer tiles around what the camera looks at.

import type { OrbitPose } from './orbit'
import type { Place } from './viewport.types'

/** Asks no more often than this, ms. */
const PAUSE_MS = 500
/** Asks again if the target has moved so far, m, or if the distance has changed by this share. */
const MOVED_M = 4
const ZOOMED = 0.15
const LEAST_RADIUS_M = 60
const MOST_RADIUS_M = 600

export class DetailWish {
  private timer: number | undefined
  private sent: { target: Place; distance: number } | undefined

  constructor(private readonly ask: (around: Place, radius: number) => void) {}

  /** The camera has moved. */
  moved(pose: Readonly<OrbitPose>): void {
    this.timer ??= window.setTimeout(() => {
      this.timer = undefined
      this.send(pose)
    }, PAUSE_MS)
  }

  /** Another map. */
  forget(): void {
    this.sent = undefined
  }

  dispose(): void {
    clearTimeout(this.timer)
  }

  private send({ target, distance }: Readonly<OrbitPose>): void {
    const { sent } = this
    const moved = sent ? Math.hypot(target.x - sent.target.x, target.z - sent.target.z) : Infinity
    if (!sent || moved > MOVED_M || Math.abs(Math.log(distance / sent.distance)) > ZOOMED) {
      this.sent = { target: { ...target }, distance }
      this.ask({ ...target }, Math.min(MOST_RADIUS_M, Math.max(LEAST_RADIUS_M, distance * 1.1)))
    }
  }
}
