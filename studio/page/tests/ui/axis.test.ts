import { describe, expect, it } from 'vitest'
import { axisOf, fromTop, HEADING_STEPS, linePoints, SPEED_STEPS, timeTicks } from '../../src/ui/motion/axis'

describe('axisOf', () => {
  it.each([
    ['a small range by the smallest step', [10, 20], HEADING_STEPS, [0, 45]],
    ['both sides of zero', [-100, 100], HEADING_STEPS, [-180, 0, 180]],
    ['several turns', [-10, 900], HEADING_STEPS, [-720, 0, 720, 1440]],
    ['one value', [0, 0], SPEED_STEPS, [0, 1]],
    ['a value on a tick', [0, 10], SPEED_STEPS, [0, 5, 10]],
    ['more than any step has', [0, 1000], SPEED_STEPS, Array.from({ length: 21 }, (_, index) => index * 50)],
  ])('has ticks around %s', (_, values, steps, ticks) => {
    expect(axisOf(values, steps, 3)).toEqual({ low: ticks[0], high: ticks.at(-1), ticks })
  })
})

describe('timeTicks', () => {
  it.each([
    [0.4, [0]],
    [9, [0, 2, 4, 6, 8]],
    [31, [0, 5, 10, 15, 20, 25, 30]],
  ])('has none beyond %d s', (length, ticks) => {
    expect(timeTicks(length, 7)).toEqual(ticks)
  })
})

describe('linePoints', () => {
  const axis = { low: 0, high: 10, ticks: [0, 10] }

  it('has the time across and the value from the top', () => {
    expect(linePoints([[0, 10], [2.5, 0]], axis)).toBe('0.000,0.0000 2.500,1.0000') // prettier-ignore
    expect(fromTop(5, axis)).toBe(0.5)
  })
})
