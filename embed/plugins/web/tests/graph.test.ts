// Plans on graphs in the page: on toy graphs, against Dijkstra's search, and against those of the planner service.

import { readFileSync, writeFileSync } from 'node:fs'
import { afterAll, beforeAll, expect, test } from 'vitest'
import { levelObj, lowestCorner } from '../examples/three/level.ts'
import { connect, type ImportedLevel, type Surefoot } from '../src/client/index.ts'
import { chanceOf, Graph, originOf, type Query, secondsOf } from '../src/plans/index.ts'
import { findPath, type Hop } from '../src/plans/search.ts'
import { Folder, run, serve, type Service } from './program.ts'
import { lineGraph, toyFile, toyGraph } from './toys.ts'

const place = (x: number, z = 0) => ({ x, y: 0, z })
const SQUARE = [place(0), place(40), place(20, 20), place(60)]

test('a careful plan goes around an edge on which characters die, and a bold one does not', () => {
  const graph = toyGraph(SQUARE, [
    [0, 1, { tries: 20, deaths: 1 }],
    [0, 2],
    [2, 1],
    [1, 3],
  ])
  const stops = (caution: number) =>
    graph.findPath({ start: place(0), goal: place(60), caution }).legs.map(({ to }) => to)
  expect(stops(1)).toEqual([0, 2, 1, 3, 'goal'])
  expect(stops(0)).toEqual([0, 1, 3, 'goal'])
})

test('plans do without abilities and legs', () => {
  const graph = toyGraph(SQUARE, [
    [0, 1, { ability: 'double_jump' }],
    [0, 2],
    [2, 1],
    [1, 3],
  ])
  const passes = (query: Partial<Query>) =>
    graph.findPath({ start: place(0), goal: place(60), ...query }).legs.some(({ to }) => to === 2)
  expect(passes({})).toBe(false)
  expect(passes({ without: ['jump'] })).toBe(true)
  expect(passes({ avoid: [{ from: 0, to: 1 }] })).toBe(true)
  expect(() => passes({ without: ['fly' as 'jump'] })).toThrow('query.without has fly')
  expect(() => passes({ caution: NaN })).toThrow('query.caution is NaN')
})

test('a near goal is headed for at once', () => {
  const plan = lineGraph().findPath({ start: place(0), goal: place(5) })
  expect(plan.legs).toMatchObject([{ from: 'start', to: 'goal' }])
})

test('A* finds what Dijkstra finds', () => {
  // A grid of 12 x 12 with costs that a linear congruence draws.
  const side = 12
  let drawn = 7
  const draw = () => (drawn = (drawn * 16_807) % 2_147_483_647) / 2_147_483_647
  const costs: number[] = []
  const outgoing = Array.from({ length: side * side }, (_, from): Hop[] => {
    const [x, z] = [from % side, Math.floor(from / side)]
    const to = [x > 0 && from - 1, x < side - 1 && from + 1, z > 0 && from - side, z < side - 1 && from + side]
    return to.filter((it) => it !== false).map((to) => ({ to, edge: costs.push(1 + draw()) - 1 }))
  })
  for (let goal = 0; goal < side * side; goal += 5) {
    const problem = {
      outgoing,
      starts: [{ vertex: 0, cost: 0 }],
      goals: [{ vertex: goal, cost: 1 }],
      costOf: (edge: number) => costs[edge]!,
    }
    const steps = (vertex: number) =>
      Math.abs((vertex % side) - (goal % side)) + Math.abs(Math.floor(vertex / side) - Math.floor(goal / side))
    const [fast, sure] = [findPath({ ...problem, bound: steps }), findPath({ ...problem, bound: () => 0 })]
    expect(fast?.cost).toBeCloseTo(sure!.cost, 9)
  }
})

test('what is wrong with a file is said by the path of the value', () => {
  const broken = (change: (file: ReturnType<typeof toyFile>) => void) => {
    const file = toyFile([place(0), place(40)], [[0, 1]])
    change(file)
    return () => Graph.read(file)
  }
  expect(broken((file) => (file.nodes[1]!.x = NaN))).toThrow('nodes[1] is (NaN, 0, 0)')
  expect(broken((file) => (file.nodes[1]!.id = 7))).toThrow('nodes[1].id is 7, but must be 1')
  expect(broken((file) => (file.edges[0]!.target = 9))).toThrow('edges[0].target is 9')
  expect(broken((file) => (file.edges[0]!.ability = 'fly'))).toThrow('edges[0].ability is fly')
  expect(broken((file) => (file.edges[0]!.evidence.prior = 2))).toThrow('edges[0].evidence.prior is 2')
  expect(broken((file) => (file.graph.legs.success = [1]))).toThrow('graph.legs.success has 1 values')
  expect(() => Graph.read({ nodes: [] })).toThrow('edges is missing')
})

test('plans name the moves that a body brings along, and do without them', () => {
  const file = toyFile([place(0), place(40)], [[0, 1, { ability: 'rope' }]])
  const graph = Graph.read({ ...file, graph: { ...file.graph, moves: [{ id: 'rope' }] } })
  const query = { start: place(0), goal: place(40) }
  expect(graph.findPath(query).legs.map(({ ability }) => ability)).toContain('rope')
  const other = graph.findPath({ ...query, without: ['rope'] })
  expect(other.legs.map(({ ability }) => ability)).not.toContain('rope')
  expect(() => graph.findPath({ ...query, without: ['fly'] })).toThrow('query.without has fly')
})

const folder = new Folder()
let service: Service
let surefoot: Surefoot
let level: ImportedLevel
let graphId: string
let graph: Graph
const exported = folder.file('graph.json')

beforeAll(async () => {
  const cache = folder.file('cache')
  const obj = folder.file('level.obj')
  writeFileSync(obj, levelObj())
  const vertices = '60'
  run('graph', 'export', obj, '--vertices', vertices, '--cache', cache, '--format', 'json', '--out', exported)
  service = await serve('plan', ['--cache', cache])
  surefoot = connect({ planner: service.url })
  level = await surefoot.importLevel('level.obj', new TextEncoder().encode(levelObj()))
  graphId = await surefoot.buildGraph(level.mapHash, { vertices: Number(vertices) })
  graph = Graph.read(readFileSync(exported, 'utf8'), level.origin)
})

afterAll(async () => {
  await service?.kill()
  folder.close()
})

test('a graph says itself where the origin of its level lies', () => {
  expect(Graph.read(readFileSync(exported, 'utf8')).vertices).toEqual(graph.vertices)
  expect(() => Graph.read({ ...toyFile(SQUARE, []), graph: { origin: [1, 2] } })).toThrow('graph.origin')
})

test('the origin of a level on its map is known without a service', () => {
  expect(originOf(lowestCorner())).toEqual(level.origin)
})

test('plans in the page are those of the planner service', async () => {
  const planner = surefoot.plannerOf(graphId, level.origin)
  const places = graph.vertices.map(({ x, y, z }, idx) => ({ x: x + Math.sin(idx), y, z: z + Math.cos(idx) }))
  places.push({ x: -5, y: 30, z: 0 }, { x: 60, y: 0, z: 60 })
  let pathCount = 0
  for (let idx = 0; idx < places.length; idx++) {
    const query: Query = {
      start: places[idx]!,
      goal: places[(idx * 17 + 31) % places.length]!,
      caution: idx % 3 === 0 ? 0.5 : 1,
      without: idx % 4 === 0 ? ['double_jump'] : [],
      avoid: idx % 5 === 0 ? [{ from: 'start', to: idx }] : [],
    }
    const [own, theirs] = [graph.findPath(query), await planner.findPath(query)]
    expect(
      own.legs.map(({ from, to }) => [from, to]),
      `query ${idx}`,
    ).toEqual(theirs.legs.map(({ from, to }) => [from, to]))
    expect([own.noPath, own.legs.map(({ ability }) => ability)]).toEqual([
      theirs.noPath,
      theirs.legs.map(({ ability }) => ability),
    ])
    expect(Math.abs(chanceOf(own) - chanceOf(theirs))).toBeLessThan(1e-4)
    expect(Math.abs(secondsOf(own) - secondsOf(theirs))).toBeLessThan(1e-2)
    own.waypoints.forEach((waypoint, at) => {
      for (const axis of ['x', 'y', 'z'] as const) expect(waypoint[axis]).toBeCloseTo(theirs.waypoints[at]![axis], 3)
    })
    if (own.noPath === undefined) pathCount += 1
  }
  expect(pathCount).toBeGreaterThan(places.length / 2)
})

test('traversals are reported to the planner', async () => {
  const { from, to } = graph.edges[0]!
  const traversal = { from, to, decisions: 9, reached: true, died: false }
  expect(await surefoot.plannerOf(graphId).report([traversal, { ...traversal, to: from }])).toBe(1)
})
