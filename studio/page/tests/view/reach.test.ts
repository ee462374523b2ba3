import { describe, expect, it } from 'vitest'
import { castGround, GroundTile, type Ray } from '../../src/view/ground'
import { layCells, trianglesWithin } from '../../src/view/reach-shape'
import { at, groundTile } from './builders'

const cell = (x: number, y: number, z: number, seconds: number) => ({ centre: at(x, y, z), seconds })
const nothing = () => undefined

describe('layCells', () => {
  it('joins neighbours at their corners, which have the mean of their times', () => {
    const sheet = layCells([cell(1, 2, 1, 4), cell(3, 2, 1, 6)], 2, nothing)
    expect(sheet.cells.map(({ corners }) => corners)).toEqual([
      [0, 1, 2, 3],
      [3, 2, 4, 5],
    ])
    expect([...sheet.seconds]).toEqual([4, 4, 5, 5, 6, 6])
    expect([...sheet.positions.slice(6, 9)]).toEqual([2, 2, 2])
  })

  it('keeps storeys apart', () => {
    const sheet = layCells([cell(1, 1, 1, 4), cell(1, 9, 1, 6)], 2, nothing)
    expect(sheet.seconds).toHaveLength(8)
  })

  it.each([
    ['follows a slope', (x: number) => x / 4, [0, 0, 0.5, 0.5]],
    ['stays where the ground is far below', () => -20, [1, 1, 1, 1]],
    ['rises with ground above the edge', () => 5, [5, 5, 5, 5]],
    ['stays where the ground is far above', () => 12, [1, 1, 1, 1]],
  ])('%s', (_, heightAt, heights) => {
    const ground = new GroundTile(groundTile(8, 2, heightAt))
    const cast = (ray: Ray) => castGround([ground], ray)?.distance
    const { positions } = layCells([cell(1, 1, 1, 1)], 2, cast)
    expect([1, 4, 7, 10].map((index) => Number(positions[index]!.toFixed(3)))).toEqual(heights)
  })
})

describe('trianglesWithin', () => {
  const sheet = layCells([cell(1, 0, 1, 2), cell(3, 0, 1, 5)], 2, nothing)

  it.each([
    [1, 0],
    [2, 2],
    [30, 4],
  ])('within %d s, there are %d triangles', (limit, count) => {
    expect(trianglesWithin(sheet, limit)).toHaveLength(count * 3)
  })

  it('faces up', () => {
    const [a, b, c] = trianglesWithin(sheet, 30).map((corner) => sheet.positions.slice(corner * 3, corner * 3 + 3))
    const [[ux, , uz], [vx, , vz]] = [b!, c!].map((it) => it.map((value, axis) => value - a![axis]!)) as [
      Float32Array,
      Float32Array,
    ]
    expect(uz! * vx! - ux! * vz!).toBeGreaterThan(0)
  })
})
