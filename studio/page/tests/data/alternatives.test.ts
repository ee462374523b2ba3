import { create } from '@bufbuild/protobuf'
import { describe, expect, it } from 'vitest'
import {
  alternativeQueries,
  edgeOf,
  legEnds,
  legKey,
  legsToAvoid,
  pickAlternatives,
} from '../../src/data/plan/alternatives'
import { PlanSchema, QueryEnd } from '../../src/gen/surefoot/planner/v1/planner_pb'

const START = { stop: { case: 'end' as const, value: QueryEnd.START } }
const GOAL = { stop: { case: 'end' as const, value: QueryEnd.GOAL } }

/** A plan from vertex to vertex, with a leg onto the graph and one off it. */
function plan(route: number[], seconds = 10, chances: number[] = []) {
  const stops = [START, ...route.map((value) => ({ stop: { case: 'vertex' as const, value } })), GOAL]
  const legs = stops.slice(1).map((to, index) => ({ from: stops[index] ?? START, to, chance: chances[index] ?? 0.9 }))
  const waypoints = legs.map((_, index) => ({ x: index + 1 }))
  return create(PlanSchema, { found: true, legs, waypoints, seconds })
}

describe('legsToAvoid', () => {
  it('takes edges of the graph, the least certain first', () => {
    const legs = legsToAvoid(plan([1, 2, 3, 4], 10, [0.1, 0.9, 0.3, 0.6, 0.1]))
    expect(legs.map(edgeOf).map((edge) => `${edge?.from}>${edge?.to}`)).toEqual(['2>3', '3>4', '1>2'])
  })

  it('takes 24 at most', () => {
    const route = Array.from({ length: 60 }, (_, vertex) => vertex)
    expect(legsToAvoid(plan(route))).toHaveLength(24)
  })

  it('asks nothing where no edge is used', () => {
    const direct = create(PlanSchema, { found: true, legs: [{ from: START, to: GOAL }] })
    expect(
      alternativeQueries({ start: { x: 0, y: 0, z: 0 }, goal: { x: 1, y: 0, z: 0 }, caution: 1, movers: [] }, direct),
    ).toEqual([])
  })

  it('leaves one leg out of each query', () => {
    const queries = alternativeQueries(
      { start: { x: 0, y: 0, z: 0 }, goal: { x: 9, y: 0, z: 0 }, caution: 0.5, movers: [] },
      plan([1, 2, 3]),
    )
    expect(queries.map(({ avoid, goal, caution }) => [avoid.length, goal?.x, caution])).toEqual([
      [1, 9, 0.5],
      [1, 9, 0.5],
    ])
  })
})

describe('pickAlternatives', () => {
  const best = plan([1, 2, 3], 10)
  const noWay = create(PlanSchema, { found: false })

  it.each([
    ['the quickest first', [plan([1, 5], 30), plan([1, 4], 20)], [20, 30]],
    ['not the best again', [plan([1, 2, 3], 10), plan([1, 4], 20)], [20]],
    ['each once', [plan([1, 4], 20), plan([1, 4], 20)], [20]],
    ['only real paths', [noWay], []],
    ['three at most', [6, 7, 8, 9].map((vertex) => plan([vertex], 10 + vertex)), [16, 17, 18]],
  ])('%s', (_, answers, seconds) => {
    expect(pickAlternatives(best, answers).map((plan) => plan.seconds)).toEqual(seconds)
  })

  it('tells ways apart by their legs, not by their times', () => {
    expect(legKey(plan([1, 2], 5))).toBe(legKey(plan([1, 2], 6)))
    expect(legKey(plan([1, 2]))).not.toBe(legKey(plan([2, 1])))
  })
})

describe('legEnds', () => {
  it('begins at the start, and goes from waypoint to waypoint', () => {
    const start = { x: 0, y: 0, z: 0 }
    const way = plan([1, 2])
    const ends = way.legs.map((_, index) => legEnds(way, index, start)).map(({ from, to }) => [from.x, to.x])
    expect(ends).toEqual([
      [0, 1],
      [1, 2],
      [2, 3],
    ])
  })
})
