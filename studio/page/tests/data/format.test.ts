import { describe, expect, it } from 'vitest'
import { count, counted, duration, factor, millis, percent, place, timeLeft } from '../../src/data/format'

describe('numbers in words', () => {
  it.each([
    [() => count(1234567n), '1,234,567'],
    [() => counted(1, 'edge'), '1 edge'],
    [() => counted(0, 'edge'), '0 edges'],
    [() => counted(2, 'vertex', 'vertices'), '2 vertices'],
    [() => percent(0), '0 %'],
    [() => percent(0.004), '0.4 %'],
    [() => percent(0.0001), '0.1 %'],
    [() => percent(0.5), '50 %'],
    [() => percent(0.994), '99.4 %'],
    [() => percent(0.9999), '99.9 %'],
    [() => percent(1), '100 %'],
    [() => duration(0.25), '0.25 s'],
    [() => duration(3.24), '3.2 s'],
    [() => duration(9.96), '10 s'],
    [() => duration(59.6), '1 min'],
    [() => duration(125), '2 min 5 s'],
    [() => duration(3780), '1 h 3 min'],
    [() => duration(Number.POSITIVE_INFINITY), '-'],
    [() => millis(420), '0.42 ms'],
    [() => millis(12_400), '12 ms'],
    [() => factor(2.5), 'x 2.5'],
    [() => factor(Math.fround(0.1)), 'x 0.1'],
    [() => factor(1000), 'x 1000'],
    [() => place({ x: 31.2, y: -0.2, z: 40.6 }), '31, 0, 41'],
    [() => place(undefined), '-'],
  ])('%s', (write, text) => {
    expect(write()).toBe(text)
  })
})

describe('timeLeft', () => {
  it.each([
    [0, 100, 5, undefined],
    [10, 0, 5, undefined],
    [25, 100, 5, 15],
    [100, 100, 5, 0],
    [120, 100, 5, 0],
  ])('of %i of %i after %i s', (done, total, elapsed, left) => {
    expect(timeLeft(done, total, elapsed)).toBe(left)
  })
})
