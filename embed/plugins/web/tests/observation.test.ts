// Observations of the page against those of the program, on a map with every feature, with rays that the page casts by itself.

import { afterAll, beforeAll, expect, test } from 'vitest'
import { Agents, type AgentState } from '../src/agents/index.ts'
import { OBSERVATION_LEN } from '../src/agents/observation.ts'
import { Policy } from '../src/agents/policy.ts'
import { connect, type Surefoot, type worldV1 } from '../src/client/index.ts'
import { DEFAULT_BODY } from '../src/agents/body.ts'
import { scale, subtract, type Vec3 } from '../src/vec3.ts'
import { Mesh } from './mesh.ts'
import { exportOnnx, Folder, serve, type Service } from './program.ts'

const FEATURES = {
  plateaus: 1,
  buildings: 1,
  water: 1,
  lava: 1,
  pads: 2,
  zipLines: 2,
  ravines: 1,
  caves: 1,
  teleporters: 3,
  jetpacks: 3,
}
const MAP = { seed: 6n, size: { width: 150, height: 60, depth: 150 }, features: FEATURES }
const COUNT = 24
/** Of these, so many move in the second test, which casts rays again for each decision. */
const MOVING = 8
const TOLERANCE = 1e-5
/**
 * The same where states are recovered from observations: rounding there moves feet by up to 2e-5 m, which turns the direction to a device
 * close by.
 */
const RECOVERED_TOLERANCE = 1e-4

const folder = new Folder()
let service: Service
let surefoot: Surefoot
let mesh: Mesh
let agents: Agents
let starts: { start: Vec3; yaw: number; goal: Vec3 }[]

beforeAll(async () => {
  service = await serve('serve')
  surefoot = connect({ world: service.url })
  const { world } = await surefoot.worlds.createWorld({ map: MAP })
  const { worldId } = world!
  mesh = new Mesh()
  for await (const tile of surefoot.worlds.getMesh({ worldId })) mesh.add(tile)
  const devices = await surefoot.worlds.getFeatures({ worldId })
  const ends = (line: worldV1.LineFeature) => ({ from: line.from!, to: line.to! })
  agents = new Agents(await Policy.load(exportOnnx(folder, 'general-reactive')), {
    count: COUNT,
    devices: {
      pads: devices.pads.map(({ centre }) => centre!),
      zipLines: devices.zipLines.map(ends),
      teleporters: devices.teleporters.map((line) => ({ ...ends(line), twoWay: line.twoWay })),
      jetpacks: devices.jetpacks,
    },
  })
  const { points } = await surefoot.worlds.sampleGround({ worldId, count: 2 * COUNT, seed: 3n })
  starts = Array.from({ length: COUNT }, (_, idx) => ({
    start: points[idx]!,
    yaw: Math.fround(idx * 0.5 - 6),
    goal: points[COUNT + idx]!,
  }))
}, 120_000)

afterAll(async () => {
  await service?.kill()
  folder.close()
})

/** Reads observations from the program's bytes. */
function rowsOf(bytes: Uint8Array): Float32Array[] {
  const values = new Float32Array(bytes.slice().buffer)
  return Array.from({ length: values.length / OBSERVATION_LEN }, (_, row) =>
    values.subarray(row * OBSERVATION_LEN, (row + 1) * OBSERVATION_LEN),
  )
}

/** The greatest difference between the values of two rows, and where it is. */
function worst(row: Float32Array, golden: Float32Array): { at: number; difference: number } {
  let found = { at: -1, difference: 0 }
  row.forEach((value, at) => {
    const difference = Math.abs(value - golden[at]!)
    if (!(difference <= found.difference)) found = { at, difference }
  })
  return found
}

/** The state that a row describes, given the heading and the goal, which the row does not contain. */
function stateIn(golden: Float32Array, yaw: number, goal: Vec3): AgentState {
  const state = golden.subarray(320)
  const [sin, cos] = [Math.sin(yaw), Math.cos(yaw)]
  const fromLocal = (x: number, y: number, z: number) => ({ x: z * sin - x * cos, y, z: z * cos + x * sin })
  const offset = scale(fromLocal(state[1]!, state[2]!, state[3]!), state[0]! * 50)
  return {
    feet: subtract(goal, offset),
    velocity: scale(fromLocal(state[6]!, state[7]!, state[8]!), 12),
    yaw,
    isGrounded: state[16] === 1,
    canJump: state[17] === 1,
    isRiding: state[34] === 1,
    breathUsed: state[19]!,
    jetpackSeconds: state[33]! * 5,
  }
}

test('observations at given places are those of the program', async () => {
  const { envId, observations } = await surefoot.envs.createEnv({ map: MAP, goals: starts })
  await surefoot.envs.closeEnv({ envId })
  const golden = rowsOf(observations)
  const agentIds = starts.map((_, idx) => idx)
  const states = starts.map(({ start, yaw }, idx) => ({
    feet: start,
    velocity: { x: 0, y: 0, z: 0 },
    yaw,
    // Characters are put down in the air: whether they stand is known after a tick.
    isGrounded: golden[idx]![336] === 1,
    canJump: golden[idx]![337] === 1,
  }))
  starts.forEach(({ start, goal }, idx) => agents.setGoal(idx, start, goal))
  const rows = agents.observe(agentIds, states, mesh.cast)
  const seen = new Set<number>()
  golden.forEach((row, idx) => {
    const own = rows.subarray(idx * OBSERVATION_LEN, (idx + 1) * OBSERVATION_LEN)
    expect(worst(own, row), `agent ${idx}`).toMatchObject({ difference: expect.toSatisfy((it) => it <= TOLERANCE) })
    row.forEach((value, at) => value !== 0 && seen.add(at >= 320 ? at : 1000 + Math.floor(at / 64)))
  })
  // The places show every channel of rays and every kind of device.
  for (const part of [1000, 1001, 1002, 1003, 1004, 343, 347, 352]) expect(seen, `values at ${part}`).toContain(part)
})

test('observations while characters move are those of the program', async () => {
  const moving = starts.slice(0, MOVING)
  const { envId, observations } = await surefoot.envs.createEnv({ map: MAP, goals: moving })
  let golden = rowsOf(observations)
  const agentIds = moving.map((_, idx) => idx)
  const yaws = moving.map(({ yaw }) => yaw)
  moving.forEach(({ start, goal }, idx) => {
    agents.begin(idx)
    agents.setGoal(idx, start, goal)
  })
  const over = new Set<number>()
  for (let decision = 0; decision < 6; decision++) {
    const states = golden.map((row, idx) => stateIn(row, yaws[idx]!, moving[idx]!.goal))
    const actions = await agents.decide(agentIds, states, mesh.cast)
    // The program receives the actions that the agents remember.
    const rounded = actions.map((action) => Object.values(action).map(Math.fround))
    const packed = new Uint8Array(new Float32Array(rounded.flat()).buffer)
    const { results } = await surefoot.envs.stepEnv({ envId, actions: { actions: packed } })
    golden = rowsOf(results!.observations)
    results!.ends.forEach(({ npc }) => over.add(npc))
    rounded.forEach(([, , turn], idx) => (yaws[idx]! += (turn! * DEFAULT_BODY.turnSpeed) / 6))
  }
  const states = golden.map((row, idx) => stateIn(row, yaws[idx]!, moving[idx]!.goal))
  const rows = agents.observe(agentIds, states, mesh.cast)
  const alive = agentIds.filter((idx) => !over.has(idx))
  expect(alive.length).toBeGreaterThan(MOVING / 2)
  for (const idx of alive) {
    const own = rows.subarray(idx * OBSERVATION_LEN, (idx + 1) * OBSERVATION_LEN)
    expect(worst(own, golden[idx]!), `agent ${idx}`).toMatchObject({
      difference: expect.toSatisfy((it) => it <= RECOVERED_TOLERANCE),
    })
  }
  await surefoot.envs.closeEnv({ envId })
})
