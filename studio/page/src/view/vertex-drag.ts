// A vertex in the user's hand: a line from where it was to where it would be put down.

import { Group } from 'three'
import { LIFT_M } from './edge-shape'
import type { Materials } from './materials'
import { LineBatch, SpriteBatch } from './overlays'
import type { Place } from './viewport.types'

const lifted = (place: Place): Place => ({ ...place, y: place.y + LIFT_M })

/** Nobody means a shorter way, m. */
const SAME_M = 0.01

export function samePlace(a: Place, b: Place): boolean {
  return Math.hypot(a.x - b.x, a.y - b.y, a.z - b.z) < SAME_M
}

export class VertexDrag extends Group {
  private readonly line: LineBatch
  private readonly dot: SpriteBatch
  private inHand: { index: number; from: Place; to: Place | undefined } | undefined

  constructor(materials: Materials) {
    super()
    this.line = new LineBatch(materials, 'dashes', 30)
    this.dot = new SpriteBatch(materials, 31)
    this.add(this.line, this.dot)
  }

  /** Which vertex it is, and where it was. */
  get held(): Readonly<{ index: number; from: Place }> | undefined {
    return this.inHand
  }

  start(index: number, from: Place): void {
    this.inHand = { index, from, to: undefined }
  }

  /** `to`: the ground under the pointer; none: over the edge of the map. */
  move(to: Place | undefined): void {
    const { inHand: held } = this
    if (!held) {
      return
    }
    held.to = to
    if (to) {
      this.line.line(lifted(held.from), lifted(to), { colour: [1, 1, 1], width: 2.5, dash: 1 })
      this.dot.sprite(lifted(to), { colour: [1, 1, 1], shape: 'ring', size: 1.8, least: 18, most: 34 })
      this.dot.sprite(lifted(to), { colour: [1, 1, 1], shape: 'disc', size: 0.8, least: 7, most: 15 })
    }
    this.line.commit()
    this.dot.commit()
  }

  /** Lets go; where it was put down, if it was. */
  end(): { index: number; to: Place } | undefined {
    const { inHand: held } = this
    this.inHand = undefined
    this.line.commit()
    this.dot.commit()
    return held?.to && { index: held.index, to: held.to }
  }

  override dispose(): void {
    this.line.dispose()
    this.dot.dispose()
  }
}
