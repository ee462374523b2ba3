import { describe, expect, it } from 'vitest'
import { Ability } from '../../src/gen/surefoot/world/v1/map_pb'
import { LOOKS } from '../../src/view/abilities'
import {
  abilityColour,
  chanceColour,
  formatColour,
  islandColour,
  parseColour,
  secondsColour,
} from '../../src/view/colours'
import {
  edgeColour,
  edgePoints,
  isShown,
  LIFT_M,
  pointAlong,
  secondsRange,
  shapeEdges,
} from '../../src/view/edge-shape'
import type { Graph, GraphEdge, GraphFilter } from '../../src/view/viewport.types'
import { at, edge, filter } from './builders'

describe('isShown', () => {
  it.each<[string, Partial<GraphEdge>, Partial<GraphFilter>, boolean]>([
    ['an edge', {}, {}, true],
    ['with the graph hidden', {}, { presence: 'off' }, false],
    ['of an ability that is left out', { ability: Ability.PAD }, { abilities: new Set([Ability.WALK]) }, false],
    ['of an ability that is let in', { ability: Ability.PAD }, { abilities: new Set([Ability.PAD]) }, true],
    ['at the lower bound of chance', { chance: 0.5 }, { minChance: 0.5 }, true],
    ['below it', { chance: 0.49 }, { minChance: 0.5 }, false],
    ['above the upper bound', { chance: 0.8 }, { maxChance: 0.7 }, false],
    ['with a way back, one-way wanted', {}, { onlyOneWay: true }, false],
    ['without a way back', { oneWay: true }, { onlyOneWay: true }, true],
    ['untouched, edited wanted', {}, { onlyEdited: true }, false],
    ['re-priced', { priceFactor: 3 }, { onlyEdited: true }, true],
    ['forced', { forced: true }, { onlyEdited: true }, true],
  ])('%s', (_, changes, wanted, expected) => {
    expect(isShown(edge(changes), filter(wanted))).toBe(expected)
  })
})

const graph: Graph = {
  vertices: [
    { position: at(0, 1, 0), island: 0, trap: false },
    { position: at(10, 3, 0), island: 0, trap: false },
    { position: at(0, 1, 10), island: 4, trap: true },
  ],
  edges: [
    edge(),
    edge({ from: 1, to: 0, seconds: 4 }),
    edge({ from: 0, to: 2, ability: Ability.PAD, seconds: 3 }),
    edge({ from: 2, to: 9 }),
  ],
}

describe('colours', () => {
  it.each<[string, GraphFilter['colour'], GraphEdge, string]>([
    ['certain', 'chance', edge({ chance: 1 }), '#2fb860'],
    ['hopeless', 'chance', edge({ chance: 0 }), '#e5383b'],
    ['quickest', 'seconds', edge({ seconds: 2 }), '#fde725'],
    ['slower than all but a few', 'seconds', edge({ seconds: 99 }), '#5b2a86'],
    ['by ability', 'ability', edge({ ability: Ability.PAD }), '#ffe23a'],
    ['half as busy as can be', 'traffic', edge(), '#f8961e'],
    ['between islands', 'island', edge({ to: 2 }), '#f4f6f8'],
  ])('%s', (_, colour, it, expected) => {
    expect(formatColour(edgeColour(it, graph, colour, { ...secondsRange(graph), npcs: 4 }))).toBe(expected)
  })

  it('tells abilities and the first islands apart', () => {
    const abilities = LOOKS.map(({ ability }) => formatColour(abilityColour(ability)))
    expect(new Set(abilities).size).toBe(abilities.length)
    const islands = Array.from({ length: 12 }, (_, island) => formatColour(islandColour(island)))
    expect(new Set(islands).size).toBe(12)
    expect(islandColour(70_000)).toBeDefined()
  })

  it('keeps to the ramps and to hexadecimal', () => {
    expect(chanceColour(7)).toEqual(chanceColour(1))
    expect(secondsColour(Number.NaN)).toEqual(secondsColour(0))
    expect(formatColour(parseColour('#0a7fc3'))).toBe('#0a7fc3')
  })
})

describe('edges', () => {
  it('keeps a pair apart, each to its right', () => {
    const there = edgePoints(at(0, 0, 0), at(10, 0, 0), edge(), true, true)
    const back = edgePoints(at(10, 0, 0), at(0, 0, 0), edge(), true, true)
    expect(there[2]).toBeGreaterThan(0.2)
    expect(back[2]).toBeLessThan(-0.2)
  })

  it('starts and ends beside the vertices, over the ground', () => {
    const points = edgePoints(at(0, 2, 0), at(10, 2, 0), edge(), false, true)
    expect(points[0]).toBeGreaterThan(0)
    expect(points.at(-3)).toBeLessThan(10)
    expect(points[1]).toBeCloseTo(2 + LIFT_M, 5)
    expect(points[2]).toBeCloseTo(0, 9)
  })

  it('bends where a character flies', () => {
    const points = edgePoints(at(0, 0, 0), at(12, 0, 0), edge({ ability: Ability.PAD }), false, false)
    const { at: top } = pointAlong(points, 0.5)
    expect(top.y).toBeGreaterThan(3)
  })

  it('leaves out what the filter hides and edges to nowhere', () => {
    expect(shapeEdges(graph, filter()).map(({ edge: { from, to } }) => [from, to])).toEqual([
      [0, 1],
      [1, 0],
      [0, 2],
    ])
    expect(shapeEdges(graph, filter({ abilities: new Set([Ability.PAD]) }))).toHaveLength(1)
    expect(shapeEdges(graph, filter({ presence: 'off' }))).toHaveLength(0)
  })

  it('points onward along a polyline', () => {
    const { at: place, towards } = pointAlong(Float32Array.from([0, 0, 0, 2, 0, 0, 4, 0, 0]), 0.6)
    expect(place.x).toBeCloseTo(2.4, 5)
    expect(towards.x).toBe(4)
  })
})
