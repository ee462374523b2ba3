import { describe, expect, it } from 'vitest'
import { chaseAngles, turnCalmly } from '../../src/view/chase'
import { at } from './builders'

const everywhere = () => true

describe('chaseAngles', () => {
  it.each([
    ['north', at(0, 0, -50), 0],
    ['east', at(50, 0, 0), -Math.PI / 2],
    ['south', at(0, 0, 50), -Math.PI],
  ])('stands behind an NPC that heads %s, a little aside', (_, goal, behind) => {
    const { azimuth, polar } = chaseAngles(at(0, 0, 0), goal, { azimuth: behind + 1, polar: 0.5 }, everywhere)
    expect(azimuth).toBeCloseTo(behind + 0.55, 5)
    expect(polar).toBeGreaterThan(1)
  })

  it('stays on the side where it is', () => {
    const goal = at(0, 0, -50)
    expect(chaseAngles(at(0, 0, 0), goal, { azimuth: -0.2, polar: 1 }, everywhere).azimuth).toBeLessThan(0)
    expect(
      chaseAngles(at(0, 0, 0), goal, { azimuth: 0.2 + 4 * Math.PI, polar: 1 }, everywhere).azimuth,
    ).toBeGreaterThan(0)
  })

  it('takes the other side or looks from higher up where rock is in the way, and from the highest where all is rock', () => {
    const goal = at(0, 0, -50)
    const present = { azimuth: 0.5, polar: 1 }
    const tried: { azimuth: number; polar: number }[] = []
    const other = chaseAngles(at(0, 0, 0), goal, present, ({ azimuth }) => azimuth < 0)
    expect([Math.sign(other.azimuth), other.polar > 1]).toEqual([-1, true])
    const above = chaseAngles(at(0, 0, 0), goal, present, ({ polar }) => polar < 0.7)
    expect([Math.sign(above.azimuth), above.polar < 0.7]).toEqual([1, true])
    const highest = chaseAngles(at(0, 0, 0), goal, present, (angles) => (tried.push(angles), false))
    expect(highest.polar).toBe(Math.min(...tried.map(({ polar }) => polar)))
  })

  it('keeps its direction at the goal', () => {
    expect(chaseAngles(at(0, 0, 0), at(1, 0, 0), { azimuth: 2, polar: 1 }, everywhere).azimuth).toBe(2)
    expect(chaseAngles(at(0, 0, 0), undefined, { azimuth: 2, polar: 1 }, everywhere).azimuth).toBe(2)
  })
})

describe('turnCalmly', () => {
  it('turns the short way, no faster than is calm, and arrives', () => {
    const angles = { azimuth: 3, polar: 1 }
    const wanted = { azimuth: -3, polar: 1.1 }
    turnCalmly(angles, wanted, 500)
    expect(angles.azimuth).toBeCloseTo(3.2, 5)
    expect(angles.polar).toBeCloseTo(1.1, 5)
    for (let step = 0; step < 10; step += 1) turnCalmly(angles, wanted, 500)
    expect(angles.azimuth).toBeCloseTo(2 * Math.PI - 3, 5)
  })
})
