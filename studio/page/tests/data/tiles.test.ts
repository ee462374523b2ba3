import { create } from '@bufbuild/protobuf'
import { describe, expect, it } from 'vitest'
import { boxOf, firstCell, missingTiles, overlap, readTile } from '../../src/data/world/tiles'
import { GetMeshResponseSchema } from '../../src/gen/surefoot/world/v1/world_pb'

const KILOMETRE = { width: 1000, height: 80, depth: 1000 }

describe('firstCell', () => {
  it.each([
    [50, 50, 0],
    [250, 250, 0],
    [300, 300, 0],
    [301, 100, 4],
    [100, 1000, 4],
  ])('of %i x %i m is %i', (width, depth, cell) => {
    expect(firstCell({ width, height: 80, depth })).toBe(cell)
  })
})

describe('missingTiles', () => {
  const none = () => false

  it.each([
    ['in the middle', { x: 500, y: 0, z: 500 }, 60, { lowX: 6, lowZ: 6, highX: 8, highZ: 8 }],
    ['at a corner', { x: 0, y: 0, z: 0 }, 10, { lowX: 0, lowZ: 0, highX: 0, highZ: 0 }],
    ['beyond the far corner', { x: 1200, y: 0, z: 1200 }, 10, { lowX: 15, lowZ: 15, highX: 15, highZ: 15 }],
    ['all of it', { x: 500, y: 0, z: 500 }, 2000, { lowX: 0, lowZ: 0, highX: 15, highZ: 15 }],
  ])('%s', (_, around, radius, range) => {
    expect(missingTiles(around, radius, KILOMETRE, none)).toEqual(range)
  })

  it('leaves out what is there', () => {
    const has = (tile: string) => !['6,7', '7,8'].includes(tile)
    const range = missingTiles({ x: 500, y: 0, z: 500 }, 60, KILOMETRE, has)
    expect(range).toEqual({ lowX: 6, lowZ: 7, highX: 7, highZ: 8 })
  })

  it('wants nothing where all is there', () => {
    expect(missingTiles({ x: 500, y: 0, z: 500 }, 60, KILOMETRE, () => true)).toBeUndefined()
  })
})

describe('ranges', () => {
  const range = { lowX: 2, lowZ: 2, highX: 3, highZ: 3 }

  it('lie within their tiles', () => {
    const { low, high } = boxOf(range, KILOMETRE)
    expect([Math.floor(low.x / 64), Math.floor(high.x / 64)]).toEqual([2, 3])
    expect([Math.floor(low.z / 64), Math.floor(high.z / 64)]).toEqual([2, 3])
  })

  it.each([
    [{ lowX: 3, lowZ: 3, highX: 9, highZ: 9 }, true],
    [{ lowX: 4, lowZ: 2, highX: 9, highZ: 3 }, false],
    [{ lowX: 0, lowZ: 0, highX: 9, highZ: 1 }, false],
  ])('%j overlaps: %s', (other, shared) => {
    expect(overlap(range, other)).toBe(shared)
  })
})

describe('readTile', () => {
  it('reads blobs wherever they lie in the message', () => {
    const padded = new Uint8Array(1 + 12)
    padded.set(new Uint8Array(Float32Array.of(1.5, -2, 3).buffer), 1)
    const indices = new Uint8Array(Uint32Array.of(0, 1, 2).buffer)
    const message = create(GetMeshResponseSchema, {
      tileX: 3,
      tileZ: 4,
      positions: padded.subarray(1),
      indices,
      surfaces: Uint8Array.of(1),
    })
    const tile = readTile(message)
    expect([...tile.positions]).toEqual([1.5, -2, 3])
    expect([...tile.indices]).toEqual([0, 1, 2])
    expect([tile.tileX, tile.tileZ, ...tile.surfaces]).toEqual([3, 4, 1])
  })

  it('leaves half a number at the end out', () => {
    const message = create(GetMeshResponseSchema, { positions: new Uint8Array(7) })
    expect(readTile(message).positions).toHaveLength(1)
  })
})
