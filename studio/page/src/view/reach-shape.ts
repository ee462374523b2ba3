// The area that an NPC reaches as a sheet on the ground. No renderer here.

import type { Ray } from './ground'
import type { Place, ReachCell } from './viewport.types'

/** Cells of one storey meet at their corners, m. */
const STOREY_M = 4
/**
 * The ground at a corner is looked for from so far above the cells around it, m: below a ceiling first, then also where
 * it is above the straight line of an edge.
 */
const ABOVE_M = [2, 8]
/** How far below the cells it may be, m. */
const BELOW_M = 4
const DOWN: Place = { x: 0, y: -1, z: 0 }

/** Corners, and the cells between them. */
export interface ReachSheet {
  /** Three numbers per corner. */
  positions: Float32Array
  /** Mean time to get to the cells around each corner, s. */
  seconds: Float32Array
  cells: readonly { seconds: number; corners: readonly number[] }[]
}

interface Corner {
  x: number
  z: number
  count: number
  height: number
  seconds: number
}

/** Lays cells on the ground. `cast`: metres along a ray to the ground. */
export function layCells(
  cells: readonly ReachCell[],
  side: number,
  cast: (ray: Ray) => number | undefined,
): ReachSheet {
  const corners: Corner[] = []
  const known = new Map<string, number>()
  const cornerOf = (column: number, row: number, { centre, seconds }: ReachCell): number => {
    const key = `${column},${row},${Math.floor(centre.y / STOREY_M)}`
    const index = known.get(key) ?? corners.length
    known.set(key, index)
    const corner = (corners[index] ??= { x: column * side, z: row * side, count: 0, height: 0, seconds: 0 })
    corner.count += 1
    corner.height += centre.y
    corner.seconds += seconds
    return index
  }
  const laid = cells.map((cell) => {
    const [column, row] = [Math.round(cell.centre.x / side - 0.5), Math.round(cell.centre.z / side - 0.5)]
    const around = SQUARE.map(([x, z]) => cornerOf(column + x, row + z, cell))
    return { seconds: cell.seconds, corners: around }
  })
  return {
    positions: Float32Array.from(corners.flatMap((corner) => [corner.x, groundAt(corner, cast), corner.z])),
    seconds: Float32Array.from(corners, ({ seconds, count }) => seconds / count),
    cells: laid,
  }
}

const SQUARE = [
  [0, 0],
  [0, 1],
  [1, 1],
  [1, 0],
] as const

/** The height of the ground at a corner, or of the cells around it where the ground is far from them. */
function groundAt({ x, z, height, count }: Corner, cast: (ray: Ray) => number | undefined): number {
  const usual = height / count
  for (const above of ABOVE_M) {
    const down = cast({ origin: { x, y: usual + above, z }, direction: DOWN })
    if (down !== undefined && down <= above + BELOW_M) return usual + above - down
  }
  return usual
}

/** Corners of the triangles of the cells that take no longer than `limit`. */
export function trianglesWithin(sheet: ReachSheet, limit: number): number[] {
  return sheet.cells.flatMap(({ seconds, corners: [a, b, c, d] }) => (seconds <= limit ? [a!, b!, c!, a!, c!, d!] : []))
}
