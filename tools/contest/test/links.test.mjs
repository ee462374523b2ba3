import assert from 'node:assert/strict'
import { before, test } from 'node:test'
import { init } from '@recast-navigation/core'
import { BODY, boxes, linked } from './levels.mjs'

const GROUND = [
  [0, -1, 0],
  [30, 0, 30],
]
const TABLE = [
  [12, 0, 12],
  [18, 3, 18],
]
const ON_TABLE = [15, 3, 15]
const ON_GROUND = [3, 0, 3]

before(() => init())

test('links lead from a table down to the ground on all four sides, and none leads up higher than the body jumps', () => {
  const { links, finder } = linked(boxes(GROUND, TABLE))
  const drops = links.filter(({ by }) => by === 'walk')
  for (const outside of [({ x }) => x < 12, ({ x }) => x > 18, ({ z }) => z < 12, ({ z }) => z > 18]) {
    assert.ok(drops.some(({ endPosition }) => outside(endPosition)))
  }
  for (const { startPosition, endPosition, bidirectional } of links) {
    assert.ok(Math.abs(startPosition.y - 3) < 0.3 && Math.abs(endPosition.y) < 0.3)
    assert.equal(bidirectional, false)
  }
  assert.equal(finder.approach({ start: ON_TABLE, goal: ON_GROUND }).isComplete, true)
  assert.equal(finder.approach({ start: ON_GROUND, goal: ON_TABLE }).isComplete, false)
})

test('links lead up to a ledge that the body can jump on, from all sides', () => {
  const low = [
    [12, 0, 12],
    [18, 2, 18],
  ]
  const { links, finder } = linked(boxes(GROUND, low))
  const climbs = links.filter(({ startPosition, endPosition }) => endPosition.y > startPosition.y + 1)
  assert.ok(climbs.length > 0 && climbs.every(({ by }) => by === 'jump'))
  for (const outside of [({ x }) => x < 12, ({ x }) => x > 18, ({ z }) => z < 12, ({ z }) => z > 18]) {
    assert.ok(climbs.some(({ startPosition }) => outside(startPosition)))
  }
  assert.equal(finder.approach({ start: ON_GROUND, goal: [15, 2, 15] }).isComplete, true)
  // Under a ceiling it cannot jump.
  const ceiling = [
    [0, 2, 0],
    [30, 2.2, 11.9],
  ]
  const under = linked(boxes(GROUND, low, ceiling)).links.filter((it) => it.endPosition.y > it.startPosition.y + 1)
  assert.ok(under.every(({ startPosition: { z } }) => z > 11.9))
})

test('no link crosses a wall around a table', () => {
  const wall = (low, high) => [
    [low[0], 0, low[1]],
    [high[0], 9, high[1]],
  ]
  const walls = [wall([11, 11], [12, 19]), wall([18, 11], [19, 19]), wall([12, 11], [18, 12]), wall([12, 18], [18, 19])]
  const { links, finder } = linked(boxes(GROUND, TABLE, ...walls))
  // From the tops of the walls, 9 m above the ground, bodies can drop.
  assert.ok(links.every(({ startPosition }) => startPosition.y > 8))
  assert.equal(finder.approach({ start: ON_TABLE, goal: ON_GROUND }).isComplete, false)
})

test('a drop into the void, and one deeper than the deepest fall, have no links', () => {
  assert.deepEqual(linked(boxes(TABLE)).links, [])
  assert.deepEqual(
    linked(
      boxes(
        [
          [0, -51, 0],
          [30, -50, 30],
        ],
        TABLE,
      ),
    ).links,
    [],
  )
})

test('a gap that the body can jump is crossed both ways, a wider one is not', () => {
  const banks = (gap) =>
    boxes(
      [
        [0, 0, 0],
        [10, 3, 6],
      ],
      [
        [10 + gap, 0, 0],
        [20 + gap, 3, 6],
      ],
    )
  const narrow = linked(banks(4))
  assert.ok(narrow.links.length > 0)
  assert.ok(narrow.links.every(({ by }) => by === 'jump'))
  const [left, right] = [
    [5, 3, 3],
    [19, 3, 3],
  ]
  assert.equal(narrow.finder.approach({ start: left, goal: right }).isComplete, true)
  assert.equal(narrow.finder.approach({ start: right, goal: left }).isComplete, true)
  // 11 m/s for a flight of one second.
  assert.deepEqual(linked(banks(12)).links, [])
})

test('a weaker body jumps less far', () => {
  const banks = boxes(
    [
      [0, 0, 0],
      [10, 3, 6],
    ],
    [
      [14, 0, 0],
      [24, 3, 6],
    ],
  )
  assert.deepEqual(linked(banks, { ...BODY, forward_speed: 3, jump_speed: 4 }).links, [])
})

test('nobody lands under a ceiling that is too low, or in lava', () => {
  const shelf = [
    [0, 1.2, 0],
    [30, 1.4, 11],
  ]
  const { links } = linked(boxes(GROUND, TABLE, shelf))
  assert.ok(links.every(({ endPosition: { y, z } }) => y > 1 || z > 11))
  const lava = { kind: 'lava', low: -1, high: 0.1, centre: [15, 6], half: [15, 6] }
  const dry = linked(boxes(GROUND, TABLE), BODY, [lava]).links
  assert.ok(dry.length > 0 && dry.every(({ endPosition: { z } }) => z > 12))
})

test('links are spaced, and the same every time', () => {
  const level = boxes(GROUND, TABLE)
  const { links } = linked(level)
  assert.deepEqual(linked(level).links, links)
  const apart = (a, b) => Math.hypot(a.x - b.x, a.y - b.y, a.z - b.z)
  for (const [at, link] of links.entries()) {
    const isRepeated = links
      .slice(0, at)
      .some(
        (other) => other.by === link.by && Math.max(apart(other.startPosition, link.startPosition), apart(other.endPosition, link.endPosition)) < 0.8,
      )
    assert.equal(isRepeated, false)
  }
})
