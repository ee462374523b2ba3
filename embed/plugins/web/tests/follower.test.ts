// Followers on toy graphs.

import { expect, test } from 'vitest'
import { Follower, Graph, type Plan, type Planner } from '../src/plans/index.ts'
import { lineGraph, toyGraph } from './toys.ts'

const GOAL = { x: 60, y: 0, z: 0 }
const START = { x: 0, y: 0, z: 0 }

test('a follower heads for one waypoint after another, and reports its traversals', async () => {
  const follower = new Follower(GOAL)
  expect(follower.advance(START, false)).toEqual({ kind: 'plan' })
  expect(await follower.makePlan(lineGraph(), START)).toEqual({ kind: 'head', waypoint: START })
  const heads = []
  for (const x of [0, 20, 40]) {
    const step = follower.advance({ ...START, x }, true)
    heads.push(step.kind === 'head' ? step.waypoint.x : step.kind)
    expect(follower.advance({ ...START, x: x + 5 }, false)).toEqual({ kind: 'keep' })
  }
  expect(heads).toEqual([20, 40, 60])
  const edges = [
    { from: 0, to: 1, decisions: 2, reached: true, died: false },
    { from: 1, to: 2, decisions: 2, reached: true, died: false },
  ]
  expect(follower.takeTraversals()).toEqual(edges)
  expect(follower.takeTraversals()).toEqual([])
})

test('after 50 decisions without coming nearer there is another plan, which avoids the leg', async () => {
  // The short edge from 0 to 1 is barred; the detour leads over 2.
  const graph = toyGraph(
    [START, { x: 60, y: 0, z: 0 }, { x: 30, y: 0, z: 25 }],
    [
      [0, 1],
      [0, 2],
      [2, 1],
    ],
  )
  const follower = new Follower(GOAL)
  follower.advance(START, false)
  await follower.makePlan(graph, START)
  follower.advance(START, true)
  expect(follower.waypoint).toEqual(GOAL)
  for (let decision = 0; decision < 50; decision++) expect(follower.advance(START, false).kind).toBe('keep')
  expect(follower.advance(START, false)).toEqual({ kind: 'plan' })
  expect(follower.takeTraversals()).toMatchObject([{ from: 0, to: 1, reached: false }])
  await follower.makePlan(graph, START)
  expect(follower.plan?.waypoints).toContainEqual({ x: 30, y: 0, z: 25 })
})

test('an attempt ends after 300 decisions without progress', () => {
  const follower = new Follower(GOAL, { replanAfter: 1000 })
  follower.follow({
    waypoints: [GOAL],
    legs: [{ from: 'start', to: 'goal', ability: 'walk', seconds: 1, chance: 1, deathChance: 0 }],
  })
  for (let decision = 0; decision <= 299; decision++) expect(follower.advance(START, false).kind).toBe('keep')
  expect(follower.advance(START, false)).toEqual({ kind: 'give-up' })
  expect(follower.advance(START, true)).toEqual({ kind: 'give-up' })
})

test('without a path it goes to the nearest place and stops there', async () => {
  const places = [0, 2, 4, 6, 8, 10, 200, 202, 204, 206, 208, 210].map((x) => ({ x, y: 0, z: 0 }))
  const joined = places.flatMap((_, idx): [number, number][] =>
    idx % 6 === 5
      ? []
      : [
          [idx, idx + 1],
          [idx + 1, idx],
        ],
  )
  const follower = new Follower({ x: 205, y: 0, z: 0 })
  follower.advance(START, false)
  await follower.makePlan(toyGraph(places, joined), START)
  expect(follower.plan).toMatchObject({ noPath: 'different-islands', nearest: { x: 10 } })
  for (const { x } of follower.plan!.waypoints.slice(0, -1)) {
    expect(follower.advance({ ...START, x }, true).kind).toBe('head')
  }
  expect(follower.advance({ ...START, x: 10 }, true)).toEqual({ kind: 'unreachable' })
})

test('a death ends the attempt and counts against its edge', async () => {
  const follower = new Follower(GOAL)
  follower.advance(START, false)
  await follower.makePlan(lineGraph(), START)
  follower.advance(START, true)
  follower.noteDeath()
  expect(follower.takeTraversals()).toMatchObject([{ from: 0, to: 1, died: true, reached: false }])
  expect(follower.advance(START, false)).toEqual({ kind: 'give-up' })
})

/** A follower of the line graph on its last leg, 16 m from the last vertex to its goal. */
async function onLastLeg(): Promise<Follower> {
  const follower = new Follower({ ...GOAL, x: 76 })
  follower.advance(START, false)
  await follower.makePlan(lineGraph(), START)
  while (!follower.isLastLeg) follower.advance(follower.waypoint!, true)
  return follower
}

test('a goal that moves a little is followed, and drifts into another plan', async () => {
  const goal = (decision: number) => ({ ...GOAL, x: 76 + 0.2 * decision })
  const follower = await onLastLeg()
  const feet = { ...GOAL, x: 70 }
  const { plan } = follower
  let heads = 0
  // At 6 to 8 m from the feet the goal drifts by 25 % of its distance after 2 m, and the waypoint follows by 15 %.
  for (let decision = 1; decision <= 9; decision++) {
    const step = follower.moveGoal(goal(decision), feet)
    expect(['keep', 'head']).toContain(step.kind)
    heads += step.kind === 'head' ? 1 : 0
    expect(Math.abs(follower.waypoint!.x - goal(decision).x)).toBeLessThanOrEqual(0.15 * (goal(decision).x - feet.x))
    expect(follower.advance(feet, false)).toEqual({ kind: 'keep' })
    expect(follower.plan).toBe(plan)
  }
  expect(heads).toBe(1)
  const kinds = [10, 11].map((decision) => follower.moveGoal(goal(decision), feet).kind)
  expect(kinds).toEqual(['keep', 'plan'])
  expect(follower.hasGoalDrifted(feet)).toBe(true)
  expect(follower.advance(feet, false), 'it keeps its plan').toEqual({ kind: 'keep' })
  await follower.makePlan(lineGraph(), feet)
  expect(follower.plan!.waypoints.at(-1)).toEqual(goal(11))
  expect(follower.moveGoal(goal(11), feet).kind).toBe('keep')
})

test('a goal that moves far asks for another plan of the same attempt', async () => {
  const follower = new Follower(GOAL)
  expect(follower.moveGoal({ ...GOAL, x: 61 }, START), 'without a plan').toEqual({ kind: 'plan' })
  await follower.makePlan(lineGraph(), START)
  follower.advance(START, true)
  const far = { ...GOAL, x: 40 }
  expect(follower.moveGoal(far, START)).toEqual({ kind: 'plan' })
  expect(follower.waypoint, 'the waypoint until then').toEqual({ ...START, x: 20 })
  await follower.makePlan(lineGraph(), START)
  expect(follower.plan!.waypoints.at(-1)).toEqual(far)
  follower.noteDeath()
  expect(follower.moveGoal(GOAL, START)).toEqual({ kind: 'give-up' })
})

test('it heads for its goal where its last waypoint lags behind', async () => {
  const follower = await onLastLeg()
  const after = { ...GOAL, x: 76.4 }
  expect(follower.moveGoal(after, { ...GOAL, x: 70 }), '0.4 m make no difference yet').toEqual({ kind: 'keep' })
  expect(follower.advance({ ...GOAL, x: 75.2 }, true)).toEqual({ kind: 'head', waypoint: after })
  expect(follower.advance({ ...GOAL, x: 75.5 }, true)).toEqual({ kind: 'keep' })
  // A target that was caught runs on.
  const next = { ...GOAL, x: 76.6 }
  expect(follower.moveGoal(next, { ...GOAL, x: 75.5 }, true)).toEqual({ kind: 'head', waypoint: next })
})

test('a goal that moves while a plan is made is where that plan leads', async () => {
  const graph = lineGraph()
  const follower = new Follower(GOAL)
  const planning = follower.makePlan({ findPath: (query) => Promise.resolve(graph.findPath(query)) }, START)
  const moved = { ...GOAL, x: 90 }
  expect(follower.moveGoal(moved, START)).toEqual({ kind: 'keep' })
  await planning
  expect(follower.plan!.waypoints.at(-1)).toEqual(moved)
  expect(follower.hasGoalDrifted(START), 'from where the plan was requested').toBe(true)
})

test('patience runs out for a character that stands still, but not for one that chases', () => {
  const straight = { from: 'start', to: 'goal', ability: 'walk', seconds: 1, chance: 1, deathChance: 0 } as const
  const ends = [0, 0.1].map((metres) => {
    const follower = new Follower(GOAL, { replanAfter: 1000 })
    follower.follow({ waypoints: [GOAL], legs: [straight] })
    let end: string | undefined
    for (let decision = 1; decision <= 400 && end === undefined; decision++) {
      const feet = { ...START, x: metres * decision }
      follower.moveGoal({ ...GOAL, x: 60 + decision }, feet)
      const { kind } = follower.advance(feet, false)
      if (kind === 'give-up') end = kind
    }
    return end
  })
  expect(ends).toEqual(['give-up', undefined])
})

test('a slow planner is waited for, and one that fails is asked again', async () => {
  const graph = lineGraph()
  const planner: Planner = { findPath: (query) => Promise.resolve().then(() => graph.findPath(query)) }
  const follower = new Follower(GOAL)
  const planning = follower.makePlan(planner, START)
  expect(follower.advance(START, false)).toEqual({ kind: 'keep' })
  await expect(follower.makePlan(planner, START)).rejects.toThrow('being made already')
  expect((await planning).kind).toBe('head')
  const other = new Follower(GOAL)
  await expect(other.makePlan({ findPath: () => Promise.reject(new Error('gone')) }, START)).rejects.toThrow('gone')
  expect(other.advance(START, false)).toEqual({ kind: 'plan' })
})

test('what cannot be followed is refused by name', () => {
  expect(() => new Follower({ x: NaN, y: 0, z: 0 })).toThrow('goal is (NaN, 0, 0)')
  expect(() => new Follower(GOAL, { patience: 0 })).toThrow('patience is 0')
  const follower = new Follower(GOAL)
  expect(() => follower.advance({ x: 0, y: NaN, z: 0 }, false)).toThrow('feet is (0, NaN, 0)')
  expect(() => follower.moveGoal({ x: 0, y: Infinity, z: 0 }, START)).toThrow('goal is (0, Infinity, 0)')
  expect(() => follower.follow({ waypoints: [], legs: [] } as Plan)).toThrow('0 waypoints and 0 legs')
  expect(() => Graph.read('{')).toThrow('graph file is no JSON')
})
