// Agents that walk to goals by plan: goals that move, and arrivals.

import { expect, test } from 'vitest'
import { Agents, type AgentState, type CastRays, OBSERVATION_LEN, Policy, Surface } from '../src/agents/index.ts'
import type { Planner, Query } from '../src/plans/index.ts'
import { Walkers } from '../src/walkers.ts'
import { lineGraph } from './toys.ts'

const START = { x: 0, y: 0, z: 0 }
const GOAL = { x: 60, y: 0, z: 0 }

const openSky: CastRays = (origins) => {
  const rays = origins.length / 3
  return { distances: new Array(rays).fill(Infinity), surfaces: new Array(rays).fill(Surface.none) }
}
/** Everything is a wall. */
const walls: CastRays = (origins) => {
  const rays = origins.length / 3
  return { distances: new Array(rays).fill(0.1), surfaces: new Array(rays).fill(Surface.ground) }
}

function standing(x: number, y = 0): AgentState {
  return { feet: { x, y, z: 0 }, velocity: START, yaw: 0, isGrounded: true, canJump: true }
}

/** Walkers on the line graph, which list the goals of their plans. Their policy stands still. */
function onLine(): { walkers: Walkers; planned: number[] } {
  const run = (observations: Float32Array) => {
    const values = new Float32Array((4 * observations.length) / OBSERVATION_LEN)
    return Promise.resolve({ means: values, logStds: values, memories: new Float32Array() })
  }
  const [graph, planned]: [Planner, number[]] = [lineGraph(), []]
  const planner = {
    findPath(query: Query) {
      planned.push(query.goal.x)
      return graph.findPath(query)
    },
  }
  const agents = new Agents({ memoryLen: 0, run } as unknown as Policy, { noiseShare: 0 })
  return { walkers: new Walkers(agents, planner), planned }
}

test('an agent that is sent to a place nearby in each frame keeps its plan', async () => {
  const { walkers, planned } = onLine()
  walkers.send(0, GOAL)
  await walkers.decide([0], [standing(0)], openSky)
  const follower = walkers.follower(0)
  for (let frame = 1; frame <= 40; frame++) {
    walkers.send(0, { ...GOAL, x: 60 + 0.1 * frame })
    if (frame % 10 === 0) await walkers.decide([0], [standing(0)], openSky)
  }
  expect(walkers.follower(0)).toBe(follower)
  expect([follower!.goal.x, planned]).toEqual([64, [60]])
  // Here and there the goal drifts by a quarter of its distance.
  for (let frame = 1; frame <= 200; frame++) walkers.send(0, { ...GOAL, x: 64 + 0.1 * frame })
  await walkers.decide([0], [standing(0)], openSky)
  expect(walkers.follower(0)).toBe(follower)
  expect(planned).toEqual([60, 84])
  walkers.send(0, { ...GOAL, x: 20 })
  expect(walkers.follower(0), 'a place far away is another attempt').not.toBe(follower)
})

test('an agent arrives where it stands in sight of its goal, and passes waypoints in flight', async () => {
  const { walkers } = onLine()
  walkers.send(0, GOAL)
  await walkers.decide([0], [standing(0)], openSky)
  const inFlight = (x: number) => ({ ...standing(x, 0.5), isGrounded: false })
  const follower = walkers.follower(0)!
  for (let leg = 0; leg < 5 && !follower.isLastLeg; leg++) {
    const { x } = follower.waypoint!
    walkers.note(0, inFlight(x))
    await walkers.decide([0], [inFlight(x - 2)], openSky)
  }
  expect(follower.isLastLeg).toBe(true)
  walkers.note(0, inFlight(60))
  expect(walkers.status(0), 'in flight').toBe('walking')
  await walkers.decide([0], [standing(59.5)], walls)
  expect(walkers.status(0), 'behind a wall').toBe('walking')
  await walkers.decide([0], [standing(58)], openSky)
  walkers.note(0, standing(59.5))
  expect(walkers.status(0)).toBe('arrived')
})

test('a goal has a radius of its own', async () => {
  const { walkers } = onLine()
  walkers.send(0, GOAL, { radius: 5 })
  await walkers.decide([0], [standing(50)], openSky)
  walkers.send(0, GOAL, { radius: 0.3 })
  walkers.note(0, standing(59.5))
  expect(walkers.status(0)).toBe('walking')
  walkers.send(0, GOAL, { radius: 5 })
  walkers.note(0, standing(55.5))
  expect(walkers.status(0)).toBe('arrived')
  expect(() => walkers.send(0, GOAL, { radius: -1 })).toThrow('radius is -1')
})

test('an agent that is sent elsewhere while its plan is made heads there', async () => {
  const { walkers } = onLine()
  walkers.send(0, GOAL)
  const decided = walkers.decide([0], [standing(0)], openSky)
  walkers.send(0, { ...GOAL, x: 20 })
  await expect(decided).rejects.toThrow('agent 0 has no goal')
  await walkers.decide([0], [standing(0)], openSky)
  expect(walkers.follower(0)!.plan!.waypoints.at(-1)!.x).toBe(20)
})
