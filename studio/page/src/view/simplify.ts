// Rougher versions of tiles, for pictures that must come quickly: corners within a cube become one. No renderer here.

import type { ShadedTile } from './shading'

/** Sides of the cubes, m; the first level is the tile as it is. */
export const LEVELS_M = [0, 1.6, 3.2, 6.4, 12.8] as const

/** The rim keeps more corners, so that rough tiles of different levels meet, m. */
const RIM_M = 3.2

/** Places of cubes are packed into one number, so many along each axis. */
const CUBES = 0x4000

/** Joins the corners of grown ground within cubes of `cell` metres; what is built stays as it is. */
export function simplifyTile(tile: ShadedTile, cell: number): ShadedTile {
  const joined = joinCorners(tile, cell)
  const places = new Places(joined.count)
  tile.rim.forEach((rim, corner) => places.add(joined.of[corner]!, tile, corner, rim === 1))
  return { ...places.means(), indices: joinedIndices(tile.indices, joined.of), rim: new Uint8Array(joined.count) }
}

/** Tells which corners become one. Those of the rim go by themselves, and those at the four ends of the rim stay. */
function joinCorners({ positions, tones, rim }: ShadedTile, cell: number): { of: Uint32Array; count: number } {
  const { low, high } = extentOf(positions)
  const of = new Uint32Array(rim.length)
  const cubes = new Map<number, number>()
  let count = 0
  const nearEnd = (at: number, axis: 0 | 2): boolean => Math.min(at - low[axis], high[axis] - at) < RIM_M * 1.5
  for (let corner = 0; corner < rim.length; corner += 1) {
    const x = positions[corner * 3]!
    const y = positions[corner * 3 + 1]!
    const z = positions[corner * 3 + 2]!
    const onRim = rim[corner] === 1
    if (tones[corner * 4 + 1]! > 127 || (onRim && nearEnd(x, 0) && nearEnd(z, 2))) {
      of[corner] = count
      count += 1
      continue
    }
    const side = onRim ? Math.min(cell, RIM_M) : cell
    const cube = (value: number): number => Math.floor(value / side) + CUBES / 2
    const key = ((cube(x) * CUBES + cube(y)) * CUBES + cube(z)) * 2 + (onRim ? 1 : 0)
    const known = cubes.get(key)
    of[corner] = known ?? count
    if (known === undefined) {
      cubes.set(key, count)
      count += 1
    }
  }
  return { of, count }
}

type Extent = [number, number, number]

function extentOf(positions: Float32Array): { low: Extent; high: Extent } {
  const low: Extent = [Infinity, Infinity, Infinity]
  const high: Extent = [-Infinity, -Infinity, -Infinity]
  for (let at = 0; at < positions.length; at += 1) {
    const axis = (at % 3) as 0 | 1 | 2
    low[axis] = Math.min(low[axis], positions[at]!)
    high[axis] = Math.max(high[axis], positions[at]!)
  }
  return { low, high }
}

/** Corners that become one: their mean, but of the rim the one that the next tile takes too, so that no gap opens. */
class Places {
  private readonly weights: Float32Array
  private readonly sums: Float32Array
  private readonly tones: Float32Array
  private readonly rim = new Set<number>()

  constructor(count: number) {
    this.weights = new Float32Array(count)
    this.sums = new Float32Array(count * 3)
    this.tones = new Float32Array(count * 4)
  }

  add(index: number, { positions, tones }: ShadedTile, corner: number, onRim: boolean): void {
    const { sums, weights } = this
    weights[index]! += 1
    for (let part = 0; part < 4; part += 1) {
      this.tones[index * 4 + part]! += tones[corner * 4 + part]!
    }
    if (onRim) {
      this.chooseRim(index, positions, corner)
      return
    }
    for (let axis = 0; axis < 3; axis += 1) {
      sums[index * 3 + axis]! += positions[corner * 3 + axis]!
    }
  }

  means(): { positions: Float32Array; tones: Uint8Array } {
    const tones = Uint8Array.from(this.tones, (sum, at) => Math.round(sum / this.weights[at >> 2]!))
    const weightOf = (index: number): number => (this.rim.has(index) ? 1 : this.weights[index]!)
    return { positions: this.sums.map((sum, at) => sum / weightOf(Math.floor(at / 3))), tones }
  }

  /** The first along x, then z, then y. */
  private chooseRim(index: number, positions: Float32Array, corner: number): void {
    const { sums } = this
    const order = [0, 2, 1]
      .map((axis) => positions[corner * 3 + axis]! - sums[index * 3 + axis]!)
      .find((step) => step !== 0)
    if (!this.rim.has(index) || (order ?? 0) < 0) {
      this.rim.add(index)
      sums.set(positions.subarray(corner * 3, corner * 3 + 3), index * 3)
    }
  }
}

function joinedIndices(indices: Uint32Array, joined: Uint32Array): Uint32Array {
  const kept = new Uint32Array(indices.length)
  let count = 0
  for (let at = 0; at < indices.length; at += 3) {
    const a = joined[indices[at]!]!
    const b = joined[indices[at + 1]!]!
    const c = joined[indices[at + 2]!]!
    if (a !== b && b !== c && c !== a) {
      kept.set([a, b, c], count)
      count += 3
    }
  }
  return kept.slice(0, count)
}

export interface LeveledTile {
  /** Triangles by level, as far as they are known; those of the first level always are. */
  counts: readonly (number | undefined)[]
  /** Square metres seen from above. */
  area: number
  /** Metres from the eye. */
  distance: number
}

/** Triangles that a tile has at a level, or is likely to have. */
export function expectedTriangles({ counts, area }: Pick<LeveledTile, 'counts' | 'area'>, level: number): number {
  const cell = LEVELS_M[level]!
  return counts[level] ?? Math.min(counts[0] ?? Infinity, (area / (cell * cell)) * 3.2 + 200)
}

/** A level for each tile: rougher with distance, and as fine as the budget of triangles allows. */
export function chooseLevels(tiles: readonly LeveledTile[], budget: number): number[] {
  for (let angle = 0.004; ; angle *= 1.3) {
    const levels = tiles.map(({ distance }) => LEVELS_M.filter((cell) => cell > 0 && cell <= distance * angle).length)
    const sum = tiles.reduce((total, tile, at) => total + expectedTriangles(tile, levels[at]!), 0)
    if (sum <= budget || angle > 100) {
      return levels
    }
  }
}
