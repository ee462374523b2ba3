// Rougher versions of tiles, for pictures that must come quickly: corners within a cube become one. No renderer here.

import type { ShadedTile } from './shading'

/** Sides of the cubes, m; the first level is the tile as it is. */
export const LEVELS_M = [0, 1.6, 3.2, 6.4, 12.8] as const

/** Joins the corners of grown ground within cubes of `cell` metres; what is built stays as it is. */
export function simplifyTile({ positions, tones, indices }: ShadedTile, cell: number): ShadedTile {
  const corners = positions.length / 3
  const joined = new Uint32Array(corners)
  const cells = new Map<string, number>()
  const sums: number[] = []
  for (let corner = 0; corner < corners; corner += 1) {
    const at = [0, 1, 2].map((axis) => Math.floor(positions[corner * 3 + axis]! / cell))
    const key = tones[corner * 4 + 1]! > 127 ? `built ${corner}` : at.join()
    const known = cells.get(key)
    const index = known ?? sums.length / 8
    if (known === undefined) {
      cells.set(key, index)
      sums.push(0, 0, 0, 0, 0, 0, 0, 0)
    }
    joined[corner] = index
    for (let part = 0; part < 3; part += 1) {
      sums[index * 8 + part]! += positions[corner * 3 + part]!
    }
    for (let part = 0; part < 4; part += 1) {
      sums[index * 8 + 3 + part]! += tones[corner * 4 + part]!
    }
    sums[index * 8 + 7]! += 1
  }
  return { ...means(sums), indices: joinedIndices(indices, joined) }
}

function means(sums: readonly number[]): Pick<ShadedTile, 'positions' | 'tones'> {
  const count = sums.length / 8
  const positions = new Float32Array(count * 3)
  const tones = new Uint8Array(count * 4)
  for (let index = 0; index < count; index += 1) {
    const weight = sums[index * 8 + 7]!
    for (let part = 0; part < 3; part += 1) {
      positions[index * 3 + part] = sums[index * 8 + part]! / weight
    }
    for (let part = 0; part < 4; part += 1) {
      tones[index * 4 + part] = Math.round(sums[index * 8 + 3 + part]! / weight)
    }
  }
  return { positions, tones }
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
  triangles: number
  /** Square metres seen from above. */
  area: number
  /** Metres from the eye. */
  distance: number
}

/** Triangles that a tile is likely to have at a level. */
export function expectedTriangles({ triangles, area }: Pick<LeveledTile, 'triangles' | 'area'>, level: number): number {
  const cell = LEVELS_M[level]!
  return cell === 0 ? triangles : Math.min(triangles, (area / (cell * cell)) * 3.2)
}

/** A level for each tile: rougher with distance, and as fine as the budget of triangles allows. */
export function chooseLevels(tiles: readonly LeveledTile[], budget: number): number[] {
  for (let angle = 0.004; ; angle *= 1.3) {
    const levels = tiles.map(({ distance }) => LEVELS_M.filter((cell) => cell > 0 && cell <= distance * angle).length)
    const sum = tiles.reduce((total, tile, at) => total + expectedTriangles(tile, levels[at]!), 0)
    if (sum <= budget || levels.every((level) => level === LEVELS_M.length - 1) || angle > 100) {
      return levels
    }
  }
}
