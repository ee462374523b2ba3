// How characters move, for animations: paces, strides, leaps, and poses of NPCs between those that are known.

import { create } from '@bufbuild/protobuf'
import { expect, test } from 'vitest'
import { type Action, type AgentState, DEFAULT_BODY, Locomotion } from '../src/agents/index.ts'
import { poseAt, worldV1 } from '../src/client/index.ts'

const REST: Action = { forward: 0, strafe: 0, turn: 0, jump: -1 }
const FORWARD: Action = { ...REST, forward: 1 }

function state(speed: number, { y = 0, isGrounded = true } = {}): AgentState {
  return { feet: { x: 0, y: 0, z: 0 }, velocity: { x: 0, y, z: speed }, yaw: 0, isGrounded, canJump: isGrounded }
}

test('a character stands, turns, walks, runs and stops', () => {
  const locomotion = new Locomotion(DEFAULT_BODY)
  const paceAt = (speed: number, action: Action) => {
    locomotion.advance(state(speed), action)
    return locomotion.pace
  }
  expect(paceAt(0, REST)).toBe('idle')
  expect(paceAt(0, { ...REST, turn: -0.5 })).toBe('turn')
  expect(paceAt(2, FORWARD)).toBe('walk')
  expect(paceAt(3, FORWARD)).toBe('run')
  expect(paceAt(3, REST)).toBe('stop')
})

test('strides are as long as those of people, and their phase follows the way', () => {
  const locomotion = new Locomotion(DEFAULT_BODY)
  let strides = 0
  for (let tick = 0; tick < 600; tick++) {
    const before = locomotion.stridePhase
    locomotion.advance(state(1.4), FORWARD)
    if (locomotion.stridePhase < before) strides += 1
  }
  expect(locomotion.strideM).toBeCloseTo(1.37, 1)
  expect(strides).toBe(Math.floor(14 / locomotion.strideM))
})

test('a jump has a flight and a landing, and a bump has neither', () => {
  const locomotion = new Locomotion(DEFAULT_BODY)
  const phases = (state: AgentState, action: Action, ticks: number) => {
    const seen = new Set<string>()
    for (let tick = 0; tick < ticks; tick++) {
      locomotion.advance(state, action)
      seen.add(locomotion.phase)
    }
    return [...seen]
  }
  expect(phases(state(5, { y: -1, isGrounded: false }), FORWARD, 5)).toEqual(['none'])
  expect(phases(state(5), FORWARD, 5)).toEqual(['none'])
  expect(phases(state(5, { y: 9, isGrounded: false }), { ...FORWARD, jump: 1 }, 30)).toEqual(['flight'])
  expect(phases(state(5), FORWARD, 13)).toEqual(['landing'])
  expect(phases(state(5), FORWARD, 5)).toEqual(['none'])
})

test('what is drawn rises smoothly over steps, follows slopes, and is where the feet are after a teleport', () => {
  const locomotion = new Locomotion(DEFAULT_BODY)
  const offsetAt = (y: number) => {
    locomotion.advance({ ...state(2), feet: { x: 0, y, z: 0 } }, FORWARD)
    return locomotion.stepOffsetM
  }
  // Steps of 0.3 x 0.3 m at 2 m/s.
  const drawn = Array.from({ length: 60 }, (_, tick) => 0.3 * Math.floor(tick / 9)).map((y) => y + offsetAt(y))
  drawn.slice(1).forEach((height, idx) => expect(height - drawn[idx]!).toBeLessThan(0.06))
  expect(drawn[9]).toBeGreaterThan(0)
  for (let tick = 0; tick < 60; tick++) offsetAt(1.8)
  expect(offsetAt(1.8)).toBe(0)
  const onSlope = Array.from({ length: 60 }, (_, tick) => offsetAt(1.8 + 0.02 * tick))
  expect(Math.max(...onSlope.map(Math.abs))).toBeLessThan(0.02)
  expect(offsetAt(8)).toBe(0)
})

test('poses lie between those that are known, and not beyond', () => {
  const at = (x: number, yaw: number) => ({ position: { x, y: 0, z: 0 }, yaw })
  const prediction = { tick: 100n, in20Ticks: at(2, 3), in40Ticks: at(5, -3) }
  const npc = create(worldV1.NpcSchema, { ...at(1, 2), movement: { prediction } })
  const placeAt = (ticks: number) => poseAt(npc, 110n, ticks)?.position.x
  expect([0, 5, 10, 20, 30].map(placeAt)).toEqual([1, 1.5, 2, 3.5, 5])
  expect(placeAt(31)).toBeUndefined()
  expect(poseAt(npc, 110n, 20)!.yaw).toBeCloseTo(Math.PI, 5)
  const unknown = create(worldV1.NpcSchema, at(1, 2))
  expect(poseAt(unknown, 110n, 0)!.position.x).toBe(1)
  expect(poseAt(unknown, 110n, 1)).toBeUndefined()
})
