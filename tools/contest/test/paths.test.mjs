import assert from 'node:assert/strict'
import { before, test } from 'node:test'
import { init } from '@recast-navigation/core'
import { agentOf, areaOfPrice, Baked } from '../navmesh.mjs'
import { PathFinder, pathPoints } from '../paths.mjs'
import { price, provedLinks } from '../surefoot.mjs'
import { BODY, boxes, linked } from './levels.mjs'

const GROUND = [
  [0, -1, 0],
  [30, 0, 30],
]
const TABLE = [
  [12, 0, 12],
  [18, 3, 18],
]

before(() => init())

test('the point after the start of a link is reached by the move along it, the others on foot', () => {
  const corners = [{ at: [0, 0, 0] }, { at: [1, 0, 0], link: { by: 'jump' } }, { at: [5.00049, 2, 0], link: { by: 'pad' } }, { at: [6, 9, 0] }, { at: [7, 9, 0] }]
  const path = pathPoints(corners)
  assert.deepEqual(
    path.map(({ by }) => by),
    ['walk', 'walk', 'jump', 'pad', 'walk'],
  )
  assert.deepEqual(path[2].at, [5, 2, 0])
})

test('the steps of a link follow the corner where it begins', () => {
  const steps = [
    { at: [1.4, 0, 0], by: 'walk' },
    { at: [5, 2, 0], by: 'jump' },
  ]
  const path = pathPoints([{ at: [0, 0, 0] }, { at: [1, 0, 0], link: { by: 'jump', steps } }, { at: [5.5, 2, 0] }])
  assert.deepEqual(
    path.map(({ at: [x], by }) => [x, by]),
    [
      [0, 'walk'],
      [1, 'walk'],
      [1.4, 'walk'],
      [5, 'jump'],
      [5.5, 'walk'],
    ],
  )
})

test('a path over a link has its two ends as points', () => {
  const level = boxes(GROUND, TABLE)
  const link = { startPosition: { x: 6, y: 0, z: 15 }, endPosition: { x: 14, y: 3, z: 15 }, radius: 1, bidirectional: true, by: 'double_jump' }
  const finder = new PathFinder(new Baked(level, agentOf(BODY), []).navMesh([link]), [link])
  const { approach, isComplete } = finder.approach({ start: [2, 0, 15], goal: [16, 3, 15] })
  assert.equal(isComplete, true)
  assert.deepEqual(
    approach.path.map(({ by }) => by),
    ['walk', 'walk', 'double_jump', 'walk'],
  )
  const atEdge = finder.approach({ start: [2, 0, 15], goal: [16, 3, 13] })
  assert.equal(atEdge.approach.path.length, 4)
  const back = finder.approach({ start: [16, 3, 15], goal: [2, 0, 15] })
  assert.equal(back.approach.path[2].by, 'double_jump')
})

test('a complete path ends on the goal, even if that is off the NavMesh', () => {
  const { finder } = linked(boxes(GROUND))
  const { approach, isComplete } = finder.approach({ start: [3, 0, 3], goal: [31, 0, 15] })
  assert.equal(isComplete, true)
  assert.deepEqual(approach.path.at(-1), { at: [31, 0, 15], by: 'walk' })
})

test('a partial path is submitted, and a place far from the NavMesh is unreachable', () => {
  const { finder } = linked(boxes(GROUND, TABLE))
  const { approach, isComplete } = finder.approach({ start: [3, 0, 3], goal: [15, 3, 15] })
  assert.equal(isComplete, false)
  const [x, y, z] = approach.path.at(-1).at
  assert.ok(Math.abs(y) < 0.3 && Math.hypot(x - 15, z - 15) < 6)
  assert.equal(finder.approach({ start: [3, 0, 3], goal: [15, 50, 15] }).approach, 'unreachable')
})

test('links of a graph become connections with the moves of the challenge', () => {
  const exported = {
    offMeshConVerts: [0, 0, 0, 11, 0, 0, 1, 1, 1, 2, 2, 2],
    offMeshConRad: [0.3, 2],
    offMeshConDir: [0, 1],
    offMeshConAreas: [1, 3],
    offMeshConSeconds: [4, 0.1],
    offMeshConDriven: [1, 0],
    offMeshConLeaps: [[{ ability: 'drop', take_off: [0, 0, 0], landing: [11, 0, 0] }], [{ ability: 'double_jump', take_off: [1, 1, 1.5], landing: [2, 2, 2] }]],
    legend: [
      { ability: 'drop', area: 1, flag: 64 },
      { ability: 'double_jump', area: 3, flag: 2 },
    ],
  }
  const [drop, jump] = provedLinks(exported, 0.25)
  assert.deepEqual([drop.by, drop.bidirectional, drop.radius, drop.endPosition], ['walk', false, 1, { x: 11, y: 0, z: 0 }])
  assert.deepEqual([jump.by, jump.bidirectional, jump.radius], ['double_jump', true, 2])
  assert.equal(price(drop, 11), 4)
  assert.deepEqual(
    jump.steps.map(({ at, by }) => [at[2], by]),
    [
      [1, 'walk'],
      [1.5, 'walk'],
      [2, 'double_jump'],
    ],
  )
  assert.ok(jump.seconds > 60, 'what no controller gets through is dear')
})

test('links that cost more lead through areas of their own, and are taken only where they pay', () => {
  // A doubling has four areas; nothing costs less than walking.
  assert.deepEqual([0.1, 1, 2, 4, 1e9].map(areaOfPrice), [1, 1, 5, 9, 39])
  const wall = [
    [14, 0, 0],
    [16, 3, 26],
  ]
  const across = (factor) => {
    const area = areaOfPrice(factor)
    const link = { startPosition: { x: 10, y: 0, z: 15 }, endPosition: { x: 20, y: 0, z: 15 }, radius: 1, bidirectional: false, by: 'jump', area }
    const finder = new PathFinder(new Baked(boxes(GROUND, wall), agentOf(BODY), []).navMesh([link]), [link])
    return finder.approach({ start: [8, 0, 15], goal: [22, 0, 15] }).approach.path.some(({ by }) => by === 'jump')
  }
  assert.equal(across(1), true)
  assert.equal(across(9), false)
})
