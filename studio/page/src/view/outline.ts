// The outline of a box that is pointed out.

import { MARK_COLOURS, parseColour } from './colours'
import type { Materials } from './materials'
import { LineBatch } from './overlays'
import type { Box, Place } from './viewport.types'

/** So far outside the box that its own faces do not hide the lines, m. */
const CLEAR_M = 0.05
/** Corners by the bits of their number: set where x, y or z is high. Edges join corners that differ in one bit. */
const CORNERS = [0, 1, 2, 3, 4, 5, 6, 7]
const AXES = [1, 2, 4]

export class OutlineView extends LineBatch {
  constructor(materials: Materials) {
    super(materials, 'lines', 26)
  }

  set(box: Box | undefined): void {
    for (const [from, to] of box ? edgesOf(box) : []) {
      this.line(from, to, { colour: [0, 0, 0], width: 6, opacity: 0.55 })
      this.line(from, to, { colour: parseColour(MARK_COLOURS.outline), width: 3 })
    }
    this.commit()
  }
}

/** The twelve edges of a box that is a little larger. */
export function edgesOf({ low, high }: Box): [from: Place, to: Place][] {
  const corner = (bits: number): Place => ({
    x: bits & 1 ? high.x + CLEAR_M : low.x - CLEAR_M,
    y: bits & 2 ? high.y + CLEAR_M : low.y - CLEAR_M,
    z: bits & 4 ? high.z + CLEAR_M : low.z - CLEAR_M,
  })
  return CORNERS.flatMap((bits) =>
    AXES.filter((axis) => (bits & axis) === 0).map((axis): [Place, Place] => [corner(bits), corner(bits | axis)]),
  )
}
