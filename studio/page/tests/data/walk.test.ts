import { describe, expect, it } from 'vitest'
import { castGround, GroundTile } from '../../src/view/ground'
import { type Cast, STILL, velocityOfKeys, velocityTowards, walk } from '../../src/data/world/walk'
import { at, groundTile } from '../view/builders'

/** Ground whose height depends on the place, 40 m wide. */
function ground(heightAt: (x: number, z: number) => number): Cast {
  const tile = new GroundTile(groundTile(40, 0.5, heightAt))
  return (origin, direction) => castGround([tile], { origin, direction })?.distance
}

const flat = ground(() => 2)
/** A step up of so many metres at x = 20. */
const step = (metres: number) => ground((x) => (x < 20 ? 2 : 2 + metres))

describe('velocityOfKeys', () => {
  it.each([
    [['KeyW'], 0, [0, -3]],
    [['ArrowUp'], 0, [0, -3]],
    [['KeyS'], 0, [0, 3]],
    [['KeyD'], 0, [3, 0]],
    [['KeyW'], Math.PI / 2, [-3, 0]],
    [['KeyA'], Math.PI / 2, [0, 3]],
    [['KeyW', 'ArrowUp'], 0, [0, -3]],
    [['KeyW', 'KeyD'], 0, [3 / Math.SQRT2, -3 / Math.SQRT2]],
  ])('%j with the camera at %f', (held, azimuth, [x, z]) => {
    const velocity = velocityOfKeys(held, azimuth, 3)
    expect(velocity?.x).toBeCloseTo(x!)
    expect(velocity?.z).toBeCloseTo(z!)
  })

  it.each([[[]], [['KeyW', 'KeyS']], [['KeyQ']]])('leads nowhere for %j', (held) => {
    expect(velocityOfKeys(held, 0, 3)).toBeUndefined()
  })
})

describe('velocityTowards', () => {
  it('goes straight, does not pass the place, and ends there', () => {
    expect(velocityTowards(at(0, 0, 0), at(6, 9, 8), 5, 0.1)).toEqual({ x: 3, z: 4 })
    expect(velocityTowards(at(0, 0, 0), at(0, 0, 0.2), 5, 0.1)).toEqual({ x: 0, z: 2 })
    expect(velocityTowards(at(0, 0, 0), at(0.05, 3, 0), 5, 0.1)).toBeUndefined()
  })
})

describe('walk', () => {
  it.each([
    ['on level ground', flat, at(10, 2, 10), { x: 3, z: -3 }, at(13, 2, 7)],
    ['on a slope', ground((x) => x / 2), at(10, 5, 10), { x: 3, z: 0 }, at(13, 6.5, 10)],
    ['up a low step', step(0.4), at(19, 2, 10), { x: 3, z: 0 }, at(22, 2.4, 10)],
    ['down a low step', step(-0.4), at(19, 2, 10), { x: 3, z: 0 }, at(22, 1.6, 10)],
    ['off a ledge, and falls', step(-2), at(19, 2, 10), { x: 3, z: 0 }, at(22, 0, 10)],
  ])('goes %s', (_, cast, from, velocity, expected) => {
    const to = walk(from, velocity, 1, cast)
    for (const axis of ['x', 'y', 'z'] as const) expect(to[axis]).toBeCloseTo(expected[axis], 1)
  })

  it.each([
    ['a wall', step(2.5), 19.5],
    ['a step that is too high', step(0.9), 19.7],
    ['a deep drop', step(-8), 19.5],
  ])('stops at %s', (_, cast, most) => {
    const to = walk(at(17, 2, 10), { x: 6, z: 0 }, 1, cast)
    expect(to.x).toBeLessThan(most)
    expect(to.x).toBeGreaterThan(18.4)
    expect(to.y).toBeLessThan(2.5)
    expect(to.y).toBeGreaterThanOrEqual(2)
  })

  it('stops at the edge of the map', () => {
    const to = walk(at(38, 2, 10), { x: 6, z: 0 }, 1, flat)
    expect(to.x).toBeGreaterThan(39.2)
    expect(to.x).toBeLessThanOrEqual(39.7)
  })

  it.each([
    ['that is met askew', (x: number, _z: number) => x > 20],
    ['that is not along an axis', (x: number, z: number) => x + z > 30],
  ])('goes along a wall %s', (_, isWall) => {
    const cast = ground((x, z) => (isWall(x, z) ? 5 : 2))
    const to = walk(at(19, 2, 8), { x: 3, z: 2 }, 3, cast)
    expect(isWall(to.x, to.z)).toBe(false)
    expect(Math.hypot(to.x - 19, to.z - 8)).toBeGreaterThan(2)
    expect(to.y).toBeCloseTo(2, 3)
  })

  it('falls no faster than a body does, and ends on the ground', () => {
    const high = at(10, 5, 10)
    expect(walk(high, STILL, 0.1, flat).y).toBeCloseTo(4.2)
    expect(walk(high, STILL, 1, flat).y).toBeCloseTo(2)
  })

  it('comes back onto ground that was raised around it', () => {
    expect(walk(at(10, 1, 10), STILL, 0.1, flat).y).toBeCloseTo(2)
  })

  it('stays where there is no ground at all', () => {
    expect(walk(at(90, 1, 10), { x: 3, z: 0 }, 1, flat)).toEqual(at(90, 1, 10))
  })
})
