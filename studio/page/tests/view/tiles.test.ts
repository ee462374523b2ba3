import { describe, expect, it } from 'vitest'
import { Surface } from '../../src/gen/surefoot/world/v1/world_pb'
import { shadeTile } from '../../src/view/shading'
import { chooseLevels, expectedTriangles, LEVELS_M, simplifyTile } from '../../src/view/simplify'
import { TileStore } from '../../src/view/tiles'
import type { MeshTile } from '../../src/view/viewport.types'
import { groundTile } from './builders'

const kept = (x: number, triangles: number): { triangles: number; middle: { x: number; z: number } } => ({
  triangles,
  middle: { x, z: 0 },
})

describe('TileStore', () => {
  it('shows the fine tile, whichever came first', () => {
    const store = new TileStore<ReturnType<typeof kept>>()
    const [coarse, fine] = [kept(0, 10), kept(0, 100)]
    store.put('0,0', fine, true)
    expect(store.put('0,0', coarse, false)).toBeUndefined()
    expect(store.shown('0,0')).toBe(fine)
    expect(store.put('0,0', kept(0, 120), true)).toBe(fine)
    expect([...store.fineKeys()]).toEqual(['0,0'])
  })

  it.each([
    ['nothing within the budget', 1000, []],
    ['the farthest first', 250, ['3,0']],
    ['as many as it takes', 150, ['3,0', '2,0']],
    ['but none without a coarse one', 0, ['3,0', '2,0', '1,0']],
  ])('drops %s', (_, budget, expected) => {
    const store = new TileStore<ReturnType<typeof kept>>()
    for (const x of [0, 1, 2, 3]) {
      store.put(`${x},0`, kept(x * 64, 100), true)
      if (x > 0) {
        store.put(`${x},0`, kept(x * 64, 5), false)
      }
    }
    const whole = store.evict({ x: 0, z: 0 }, budget + 100).map(({ key }) => key)
    expect(whole).toEqual(expected)
    expect([...store.allShown()]).toHaveLength(4)
  })
})

/** A box with its own six corners to a side, counter-clockwise from outside. */
function box(): MeshTile {
  const positions = [0, 0, 0, 5, 0, 0, 5, 0, 5, 0, 0, 5, 0, 5, 0, 5, 5, 0, 5, 5, 5, 0, 5, 5]
  const indices = [
    4, 7, 6, 4, 6, 5, 0, 1, 2, 0, 2, 3, 0, 4, 5, 0, 5, 1, 3, 2, 6, 3, 6, 7, 0, 3, 7, 0, 7, 4, 1, 5, 6, 1, 6, 2,
  ]
  return {
    tileX: 0,
    tileZ: 0,
    positions: Float32Array.from(positions),
    indices: Uint32Array.from(indices),
    surfaces: new Uint8Array(12).fill(Surface.GROUND),
  }
}

describe('shadeTile', () => {
  it('shares the corners of smooth ground and marks the rim', () => {
    const shaded = shadeTile(groundTile(8, 1, (x, z) => Math.sin(x) * 0.1 + z * 0.1))
    expect(shaded.positions.length / 3).toBe(81)
    expect(shaded.indices.length / 3).toBe(128)
    expect(shaded.rim.reduce((sum, it) => sum + it, 0)).toBe(32)
    expect(shaded.tones[1]).toBe(0)
  })

  it('gives the sides of a house corners of their own, and knows that it is built', () => {
    const shaded = shadeTile(box())
    expect(shaded.positions.length / 3).toBe(24)
    expect([...shaded.tones].filter((_, at) => at % 4 === 1).every((built) => built === 255)).toBe(true)
    expect(shaded.rim.includes(1)).toBe(false)
  })

  it.each([
    [Surface.GROUND, 128],
    [Surface.WATER, 0],
    [Surface.PAD, 0],
  ])('of surface %i draws %i triangles', (surface, expected) => {
    expect(shadeTile(groundTile(8, 1, () => 1, surface)).indices.length / 3).toBe(expected)
  })

  it('darkens hollows and brightens ridges', () => {
    const hollow = shadeTile(groundTile(8, 1, (x, z) => (Math.abs(x - 4) + Math.abs(z - 4)) * 0.5))
    const ridge = shadeTile(groundTile(8, 1, (x, z) => (Math.abs(x - 4) + Math.abs(z - 4)) * -0.5))
    expect(hollow.tones[40 * 4 + 3]).toBeLessThan(120)
    expect(ridge.tones[40 * 4 + 3]).toBeGreaterThan(135)
  })
})

describe('simplifyTile', () => {
  const rolling = (x: number, z: number): number => Math.sin(x / 6) + Math.cos(z / 4)

  it('has fewer triangles the larger the cubes are', () => {
    const shaded = shadeTile(groundTile(64, 1, rolling))
    const counts = LEVELS_M.slice(1).map((cell) => simplifyTile(shaded, cell).indices.length / 3)
    expect(counts[0]).toBeLessThan(shaded.indices.length / 3)
    expect([...counts].sort((a, b) => b - a)).toEqual(counts)
    expect(counts.at(-1)).toBeLessThan(400)
  })

  it('meets the neighbouring tile without a gap', () => {
    const west = groundTile(64, 1, rolling)
    const east = groundTile(64, 1, (x, z) => rolling(x + 64, z))
    east.positions.forEach((value, at) => (east.positions[at] = at % 3 === 0 ? value + 64 : value))
    const seamOf = (tile: MeshTile): string[] => {
      const { positions } = simplifyTile(shadeTile(tile), 6.4)
      const corners = Array.from({ length: positions.length / 3 }, (_, at) => [...positions.slice(at * 3, at * 3 + 3)])
      return corners
        .filter(([x]) => Math.abs(x! - 64) < 1e-4)
        .map((corner) => corner.join())
        .sort()
    }
    expect(seamOf(west).length).toBeGreaterThan(15)
    expect(seamOf(west)).toEqual(seamOf(east))
  })

  it('leaves houses as they are', () => {
    const shaded = shadeTile(box())
    expect(simplifyTile(shaded, 12.8).indices).toHaveLength(shaded.indices.length)
  })
})

describe('chooseLevels', () => {
  const tiles = [0, 60, 120, 240, 480].map((distance) => ({ counts: [10_000], area: 4096, distance }))

  it.each([1_000_000, 30_000, 12_000, 3_000])(
    'keeps to %i triangles if it can, and is rougher farther off',
    (budget) => {
      const levels = chooseLevels(tiles, budget)
      expect([...levels].sort((a, b) => a - b)).toEqual(levels)
      const sum = tiles.reduce((total, tile, at) => total + expectedTriangles(tile, levels[at]!), 0)
      expect(sum <= budget || levels.slice(1).every((level) => level === LEVELS_M.length - 1)).toBe(true)
    },
  )
})
