import { create } from '@bufbuild/protobuf'
import { describe, expect, it } from 'vitest'
import { passes, SHOW_ALL } from '../../src/data/graph/filter'
import { graphToShow, islandsOf } from '../../src/data/graph/islands'
import { GetGraphResponseSchema } from '../../src/gen/surefoot/planner/v1/planner_pb'
import { Ability } from '../../src/gen/surefoot/world/v1/map_pb'

const edges = (text: string) =>
  text
    .split(' ')
    .filter((pair) => pair !== '')
    .map((pair) => {
      const [from, to] = pair.split('>').map(Number)
      return { from: from ?? 0, to: to ?? 0 }
    })

describe('islandsOf', () => {
  // Vertices 0 to 2 are the main island, 3 and 4 one of their own each.
  const membership = [5, 5, 5, 1, 2]
  const ring = '0>1 1>2 2>0'

  it.each([
    ['alone', ring, 'apart', 'apart'],
    ['a trap', `${ring} 1>3`, 'trap', 'apart'],
    ['a source', `${ring} 3>1`, 'source', 'apart'],
    ['a trap behind a trap', `${ring} 0>3 3>4`, 'trap', 'trap'],
    ['a source before a source', `${ring} 4>3 3>0`, 'source', 'source'],
    ['a way past', `${ring} 3>4`, 'apart', 'apart'],
    ['out of the one, into the other', `${ring} 3>0 1>4`, 'source', 'trap'],
    ['a source that leads to a trap as well', `${ring} 3>0 3>4 0>4`, 'source', 'trap'],
  ])('%s', (_, given, third, fourth) => {
    const islands = islandsOf(membership, edges(given))
    const standing = (id: number) => islands.find((island) => island.id === id)?.standing
    expect([standing(5), standing(1), standing(2)]).toEqual(['main', third, fourth])
  })

  it('tells ways in and where an island leads', () => {
    const islands = islandsOf(membership, edges(`${ring} 0>3 1>3 3>4`))
    expect(islands.map(({ id }) => id)).toEqual([5, 1, 2])
    expect(islands[1]).toMatchObject({ vertices: [3], entrances: edges('0>3 1>3'), leadsTo: [2] })
  })

  it('holds nothing for no graph', () => {
    expect(islandsOf([], [])).toEqual([])
    expect(islandsOf([0, 1], [], [1]).map(({ vertices }) => vertices)).toEqual([[0]])
  })

  it('walks a long chain of islands', () => {
    const count = 20_000
    const membership = Array.from({ length: count }, (_, vertex) => vertex)
    const chain = Array.from({ length: count - 1 }, (_, vertex) => ({ from: vertex, to: vertex + 1 }))
    const islands = islandsOf(membership, chain)
    expect(islands.filter(({ standing }) => standing === 'trap')).toHaveLength(count - 1)
  })
})

describe('graphToShow', () => {
  const graph = create(GetGraphResponseSchema, {
    vertices: [{ x: 0 }, { x: 1 }, { x: 2 }],
    islands: [0, 0, 1],
    edges: [
      { from: 0, to: 1, ability: Ability.WALK, chance: 0.5, priceFactor: 1 },
      { from: 1, to: 0, ability: Ability.JUMP, chance: 0.9 },
      { from: 1, to: 2, ability: Ability.PAD, chance: 1, priceFactor: 4, forced: true },
    ],
  })
  const shown = graphToShow(graph, islandsOf(graph.islands, graph.edges))

  it('marks traps and edges without a way back', () => {
    expect(shown.vertices.map(({ trap }) => trap)).toEqual([false, false, true])
    expect(shown.edges.map(({ oneWay }) => oneWay)).toEqual([false, false, true])
  })

  it('takes a missing factor for one', () => {
    expect(shown.edges.map(({ priceFactor }) => priceFactor)).toEqual([1, 1, 4])
  })

  it.each([
    [{}, 3],
    [{ abilities: new Set([Ability.WALK, Ability.PAD]) }, 2],
    [{ minChance: 0.6 }, 2],
    [{ maxChance: 0.6 }, 1],
    [{ onlyOneWay: true }, 1],
    [{ onlyEdited: true }, 1],
    [{ onlyEdited: true, maxChance: 0.5 }, 0],
  ])('filter %j leaves %i edges', (change, left) => {
    expect(shown.edges.filter((edge) => passes(edge, { ...SHOW_ALL, ...change }))).toHaveLength(left)
  })
})
