import { describe, expect, it } from 'vitest'
import { Surface } from '../../src/gen/surefoot/world/v1/world_pb'
import { castGround, GroundTile, type Ray } from '../../src/view/ground'
import type { Place } from '../../src/view/viewport.types'
import { at, groundTile } from './builders'

const ray = (origin: Place, towards: Place): Ray => {
  const [x, y, z] = [towards.x - origin.x, towards.y - origin.y, towards.z - origin.z]
  const length = Math.hypot(x, y, z)
  return { origin, direction: at(x / length, y / length, z / length) }
}

const hills = (x: number, z: number): number => 5 + 3 * Math.sin(x / 7) + 2 * Math.cos(z / 5)

describe('castGround', () => {
  const flat = new GroundTile(groundTile(64, 1, () => 2))

  it.each([
    ['straight down', at(10.3, 30, 20.7), at(10.3, 0, 20.7), at(10.3, 2, 20.7)],
    ['slanting', at(0, 12, 0), at(20, 2, 30), at(20, 2, 30)],
    ['from outside of the box', at(-50, 52, 32), at(0.5, 1.5, 32), at(0, 2, 32)],
    ['along an axis', at(32.5, 12, -20), at(32.5, 2, 40), at(32.5, 2, 40)],
  ])('meets level ground %s', (_, origin, towards, expected) => {
    const hit = castGround([flat], ray(origin, towards))
    expect(hit?.at.x).toBeCloseTo(expected.x, 0)
    expect(hit?.at.y).toBeCloseTo(expected.y, 3)
    expect(hit?.at.z).toBeCloseTo(expected.z, 1)
    expect(hit?.surface).toBe(Surface.GROUND)
  })

  it.each([
    ['upwards', at(10, 30, 10), at(10, 60, 10)],
    ['beside the map', at(-10, 30, 10), at(-10, 0, 10)],
    ['from below: that is the inside of rock', at(10, 0, 10), at(10, 10, 10)],
  ])('meets nothing %s', (_, origin, towards) => {
    expect(castGround([flat], ray(origin, towards))).toBeUndefined()
  })

  it('finds the same as a search of all triangles', () => {
    const tile = groundTile(64, 1, hills)
    const fast = new GroundTile(tile)
    const slow = Array.from(
      { length: tile.indices.length / 3 },
      (_, face) =>
        new GroundTile({
          ...tile,
          indices: tile.indices.slice(face * 3, face * 3 + 3),
          surfaces: tile.surfaces.slice(face, face + 1),
        }),
    )
    for (let turn = 0; turn < 24; turn += 1) {
      const origin = at(32 + 60 * Math.cos(turn), 14 + turn, 32 + 60 * Math.sin(turn))
      const towards = ray(origin, at(32 + 9 * Math.sin(turn * 3), 5, 32 + 9 * Math.cos(turn * 5)))
      const expected = castGround(slow, towards)
      expect(castGround([fast], towards)?.distance ?? -1).toBeCloseTo(expected?.distance ?? -1, 3)
    }
  })

  it('takes the nearest of several tiles', () => {
    const upper = new GroundTile(groundTile(64, 4, () => 8, Surface.WATER))
    const hit = castGround([flat, upper], ray(at(9, 30, 9), at(9, 0, 9)))
    expect(hit).toMatchObject({ surface: Surface.WATER, distance: 22 })
  })

  it('passes what lies above a section', () => {
    const upper = new GroundTile(groundTile(64, 4, () => 8))
    expect(castGround([flat, upper], ray(at(9, 30, 9), at(9, 0, 9)), 5)?.at.y).toBeCloseTo(2, 4)
    expect(castGround([flat, upper], ray(at(9, 30, 9), at(9, 0, 9)), 1)).toBeUndefined()
  })
})
