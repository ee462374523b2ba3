import { describe, expect, it } from 'vitest'
import { poseAt, PoseBuffer, TickClock } from '../../src/view/poses'
import { at, pose } from './builders'

describe('TickClock', () => {
  it.each([
    ['ten messages a second', 6, 100],
    ['twenty messages a second', 3, 50],
    ['a world at half speed', 3, 100],
  ])('runs about one message late and never back: %s', (_, ticks, ms) => {
    const clock = new TickClock()
    let before = -Infinity
    for (let message = 0; message < 80; message += 1) {
      clock.receive(message * ticks, message * ms)
      for (let part = 0; part < 5; part += 1) {
        const shown = clock.at(message * ms + (part * ms) / 5)
        expect(shown).toBeGreaterThanOrEqual(before)
        before = shown
      }
    }
    const late = 79 * ticks + (4 / 5) * ticks - before
    expect(late).toBeGreaterThan(ticks * 0.8)
    expect(late).toBeLessThan(ticks * 2)
  })

  it('does not run ahead of what is known by more than a little', () => {
    const clock = new TickClock()
    for (let message = 0; message < 20; message += 1) {
      clock.receive(message * 6, message * 100)
      clock.at(message * 100)
    }
    expect(clock.at(20_000)).toBeLessThanOrEqual(19 * 6 + 6)
  })

  it('starts over with another world', () => {
    const clock = new TickClock()
    clock.receive(9000, 0)
    clock.receive(12, 100)
    expect(clock.at(100)).toBeLessThanOrEqual(18)
  })
})

describe('poseAt', () => {
  const samples = [
    { tick: 0, pose: pose(1, at(0, 0, 0), at(6, 0, 0), 3) },
    { tick: 6, pose: pose(1, at(1, 2, 0), at(6, 0, 0), -3) },
  ]

  it.each([
    ['before the first', -3, at(0, 0, 0)],
    ['between two', 3, at(0.5, 1, 0)],
    ['at the last', 6, at(1, 2, 0)],
    ['carried on', 9, at(1.3, 2, 0)],
    ['carried on, but not for ever', 600, at(1.6, 2, 0)],
  ])('%s', (_, tick, expected) => {
    const { x, y, z } = poseAt(samples, tick)
    expect([x, y, z].map((value) => Math.round(value * 1000) / 1000)).toEqual([expected.x, expected.y, expected.z])
  })

  it('turns the short way', () => {
    expect(Math.abs(poseAt(samples, 3).yaw)).toBeCloseTo(Math.PI, 5)
  })

  it('does not draw a way to where an NPC was put', () => {
    const jump = [samples[0]!, { tick: 6, pose: pose(1, at(40, 0, 0)) }]
    expect(poseAt(jump, 5).x).toBe(0)
    expect(poseAt(jump, 6).x).toBe(40)
  })
})

describe('PoseBuffer', () => {
  it('moves an NPC forward only, in small steps, though messages come late', () => {
    const buffer = new PoseBuffer()
    const delays = [0, 30, 5, 90, 0, 60, 10, 0, 120, 20]
    const messages = Array.from({ length: 60 }, (_, index) => ({
      at: index * 100 + delays[index % 10]!,
      tick: index * 6,
    })).sort((a, b) => a.at - b.at)
    let before = -Infinity
    let largest = 0
    for (let now = 0; now < 6000; now += 16) {
      while (messages[0] && messages[0].at <= now) {
        const { tick } = messages.shift()!
        buffer.receive(tick, [pose(1, at(tick / 12, 0, 0), at(5, 0, 0))], now)
      }
      buffer.advance(now, 16)
      const shown = buffer.find(1n)!
      if (now > 1000) {
        expect(shown.x).toBeGreaterThanOrEqual(before - 1e-9)
        largest = Math.max(largest, shown.x - before)
      }
      before = shown.x
    }
    expect(largest).toBeLessThan(0.35)
    expect(before).toBeGreaterThan(27)
  })

  it('comes to rest, so that nothing more is drawn', () => {
    const buffer = new PoseBuffer()
    buffer.receive(0, [pose(1, at(0, 0, 0))], 0)
    buffer.receive(6, [pose(1, at(1, 0, 0))], 100)
    expect(buffer.advance(150, 50)).toBe(true)
    let now = 200
    while (buffer.advance(now, 16) && now < 3000) {
      now += 16
    }
    expect(now).toBeLessThan(1500)
    expect(buffer.find(1n)?.x).toBeCloseTo(1, 2)
  })

  it('forgets those that are gone and snaps those that were put elsewhere', () => {
    const buffer = new PoseBuffer()
    buffer.receive(0, [pose(1, at(0, 0, 0)), pose(2, at(3, 0, 0))], 0)
    buffer.receive(6, [pose(2, at(90, 0, 0))], 100)
    expect(buffer.shown.map(({ id }) => id)).toEqual([2n])
    let snaps = 0
    for (let now = 100; now < 600; now += 16) {
      buffer.advance(now, 16)
      const { x, snapped } = buffer.find(2n)!
      snaps += snapped ? 1 : 0
      expect([3, 90]).toContain(Math.round(x))
    }
    expect(snaps).toBe(1)
  })
})
