// Agents as their callers meet them: what they remember, and what they refuse.

import { expect, test } from 'vitest'
import {
  Agents,
  type AgentState,
  type CastRays,
  type Decided,
  OBSERVATION_LEN,
  Policy,
  RAY_COUNT,
  Surface,
  type Vec3,
} from '../src/agents/index.ts'

const FEET = { x: 0, y: 0, z: 0 }
const STATE: AgentState = { feet: FEET, velocity: FEET, yaw: 0, isGrounded: true, canJump: true }
const GOAL = { x: 0, y: 0, z: 10 }
const OPEN_SKY: CastRays = (origins) => {
  const rays = origins.length / 3
  return { distances: new Array(rays).fill(Infinity), surfaces: new Array(rays).fill(Surface.none) }
}

/** A policy that always runs forward, and counts its decisions in its memory. */
function runner(): Policy {
  const run = (observations: Float32Array, memories: Float32Array): Promise<Decided> => {
    const rows = observations.length / OBSERVATION_LEN
    const means = new Float32Array(4 * rows).map((_, idx) => (idx % 4 === 0 ? 1 : 0))
    return Promise.resolve({ means, logStds: new Float32Array(4 * rows), memories: memories.map((value) => value + 1) })
  }
  return { memoryLen: 1, run } as unknown as Policy
}

/** One value of the state vector that an agent would be shown. */
function stateValue(agents: Agents, at: number, state = STATE): number {
  return agents.observe([0], [state], OPEN_SKY)[320 + at]!
}

test('an agent is shown its last action, its acceleration and its lack of progress', async () => {
  const agents = new Agents(runner(), { noiseShare: 0 })
  agents.setGoal(0, FEET, GOAL)
  const [action] = await agents.decide([0], [STATE], OPEN_SKY)
  expect(action).toEqual({ forward: Math.tanh(1), strafe: 0, turn: 0, jump: 0 })
  const moving = { ...STATE, velocity: { x: 0, y: 0, z: 6 } }
  const row = agents.observe([0], [moving], OPEN_SKY).subarray(320)
  expect([row[8], row[11], row[18]]).toEqual([0.5, 0.5, Math.fround(1 / 300)])
  expect(row[12]).toBeCloseTo(Math.tanh(1), 6)
})

test('an agent that was reset remembers nothing', async () => {
  const agents = new Agents(runner(), { noiseShare: 0 })
  agents.setGoal(0, FEET, GOAL)
  await agents.decide([0], [STATE], OPEN_SKY)
  agents.begin(0)
  agents.setGoal(0, FEET, GOAL)
  expect([stateValue(agents, 12), stateValue(agents, 18)]).toEqual([0, 0])
})

test('noise is repeatable, and differs from agent to agent', async () => {
  const decide = async () => {
    const agents = new Agents(runner(), { count: 2 })
    for (const agent of [0, 1]) agents.setGoal(agent, FEET, GOAL)
    return agents.decide([0, 1], [STATE, STATE], OPEN_SKY)
  }
  const [first, second] = [await decide(), await decide()]
  expect(first).toEqual(second)
  expect(first[0]).not.toEqual(first[1])
})

test('rays begin at the eyes, and the middle of the cone looks ahead', () => {
  const agents = new Agents(runner())
  agents.setGoal(0, FEET, GOAL)
  let rays: number[][] = []
  agents.observe([0], [{ ...STATE, yaw: Math.PI / 2 }], (origins, directions) => {
    rays = [[...origins.subarray(0, 3)], [...directions.subarray(3 * 36, 3 * 36 + 3)]]
    expect(origins.length).toBe(3 * RAY_COUNT)
    return OPEN_SKY(origins, directions)
  })
  expect(rays[0]![1]).toBeCloseTo(1.53)
  // Heading pi / 2 faces +x; 7 degrees to the right of it is towards +z.
  expect(rays[1]![0]).toBeCloseTo(Math.cos((5 * Math.PI) / 180) * Math.cos((7 * Math.PI) / 180))
  expect(rays[1]![2]).toBeGreaterThan(0)
})

test('a character has arrived where it stands and nothing solid is between', () => {
  const agents = new Agents(runner())
  const standing = (x: number, y = 0) => ({ feet: { x, y, z: 0 }, isGrounded: true })
  const arrives = (state: { feet: Vec3; isGrounded: boolean }, castRays = OPEN_SKY, radius?: number) =>
    agents.hasArrived(state, { goal: FEET, radius }, castRays)
  const cases: [name: string, state: { feet: Vec3; isGrounded: boolean }, expected: boolean][] = [
    ['beside the goal', standing(0.9), true],
    ['at the goal', standing(0), true],
    ['too far', standing(1.1), false],
    ['in the air', { ...standing(0.5), isGrounded: false }, false],
    ['on a crate', standing(0.2, 0.8), false],
    ['below a goal that hangs above its ground', standing(0, -0.59), true],
    ['on a slope', standing(0.7, 0.65), true],
  ]
  for (const [name, state, expected] of cases) expect(arrives(state), name).toBe(expected)
  expect(arrives(standing(0.5), OPEN_SKY, 0.4)).toBe(false)
  const wallAt =
    (far: number, surface: Surface, ray: number): CastRays =>
    (origins) => {
      expect([...origins].map((value) => value.toFixed(2))).toEqual(['0.80', '0.45', '0.00', '0.80', '1.35', '0.00'])
      const surfaces = [0, 1].map((idx) => (idx === ray ? surface : Surface.none))
      return { distances: [far, far], surfaces }
    }
  for (const ray of [0, 1]) {
    expect(arrives(standing(0.8), wallAt(0.5, Surface.ground, ray)), 'a wall').toBe(false)
    expect(arrives(standing(0.8), wallAt(0.85, Surface.ground, ray)), 'a wall behind the goal').toBe(true)
    expect(arrives(standing(0.8), wallAt(0.5, Surface.water, ray)), 'water').toBe(true)
  }
  expect(() => arrives(standing(0), OPEN_SKY, NaN)).toThrow('radius is NaN, but must be a number from 0 to 30')
})

test('what makes no sense is refused by name', async () => {
  const agents = new Agents(runner(), { count: 2 })
  expect(() => agents.observe([0], [STATE], OPEN_SKY)).toThrow('agent 0 has no goal: call setGoal first')
  agents.setGoal(0, FEET, GOAL)
  const observe = (state: Partial<AgentState>, castRays = OPEN_SKY) =>
    agents.observe([0], [{ ...STATE, ...state }], castRays)
  const hits = (distances: number[], surfaces: number[]) => () => ({ distances, surfaces })
  const many = <T>(value: T) => new Array<T>(RAY_COUNT).fill(value)
  expect(() => observe({ velocity: { x: NaN, y: 0, z: 0 } })).toThrow('states[0].velocity is (NaN, 0, 0)')
  expect(() => observe({ yaw: Infinity })).toThrow('states[0].yaw is Infinity')
  expect(() => observe({ breathUsed: 2 })).toThrow('states[0].breathUsed is 2, but must be a number from 0 to 1')
  expect(() => observe({}, hits([1], [1]))).toThrow('distances that castRays returned has 1 values, but must have 64')
  expect(() => observe({}, hits(many(NaN), many(1)))).toThrow('distances[0] of castRays is NaN')
  expect(() => observe({}, hits(many(1), many(9)))).toThrow('surfaces[0] of castRays is 9')
  expect(() => agents.observe([0, 0], [STATE, STATE], OPEN_SKY)).toThrow('decides twice')
  expect(() => agents.observe([0], [], OPEN_SKY)).toThrow('1 agents, but 0 states')
  expect(() => agents.setGoal(5, FEET, GOAL)).toThrow('agent is 5, but must be a number from 0 to 1')
  expect(() => new Agents(runner(), { body: { height: 9 } })).toThrow('body.height is 9')
  expect(() => new Agents(runner(), { body: { size: 9 } as object })).toThrow('body.size is no field of a body')
  expect(() => new Agents(runner(), { devices: { pads: [{ x: NaN, y: 0, z: 0 }] } })).toThrow('devices.pads[0]')
  const first = agents.decide([0], [STATE], OPEN_SKY)
  await expect(agents.decide([0], [STATE], OPEN_SKY)).rejects.toThrow('agent 0 is still deciding')
  await first
})
