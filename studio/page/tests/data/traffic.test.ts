import { describe, expect, it } from 'vitest'
import { TrafficCounter } from '../../src/data/graph/traffic'
import type { Graph } from '../../src/view/viewport.types'
import { at, edge } from '../view/builders'

const vertex = (x: number, z: number) => ({ position: at(x, 1, z), island: 0, trap: false })
const graph: Graph = {
  vertices: [vertex(0, 0), vertex(10, 0), vertex(10, 10), vertex(4, 6)],
  edges: [
    edge({ from: 0, to: 1 }),
    edge({ from: 2, to: 1 }),
    edge({ from: 1, to: 2 }),
    edge({ from: 3, to: 1 }),
    edge({ from: 3, to: 2 }),
  ],
}
const heading = (position: ReturnType<typeof at>, waypoint?: ReturnType<typeof at>) => ({ position, waypoint })

describe('TrafficCounter', () => {
  it('counts NPCs on the edge beside them that leads to their waypoint', () => {
    const traffic = new TrafficCounter(graph).count([
      heading(at(5, 1, 0.5), at(10, 1, 0)),
      heading(at(2, 1, -0.5), at(10.1, 1, 0)),
      heading(at(9.5, 1, 5), at(10, 1, 0)),
      heading(at(10.5, 1, 5), at(10, 1, 10)),
    ])
    expect([...traffic].sort()).toEqual([
      ['0>1', 2],
      ['1>2', 1],
      ['2>1', 1],
    ])
  })

  it('ignores NPCs that head for no vertex or are far from its edges', () => {
    const counter = new TrafficCounter(graph)
    const npcs = [
      heading(at(5, 1, 0)),
      heading(at(5, 1, 0), at(7, 1, 0)),
      heading(at(30, 1, 30), at(10, 1, 0)),
      heading(at(5, 1, 0), at(0, 1, 0)),
    ]
    expect(counter.count(npcs).size).toBe(0)
  })

  it('leaves out vertices that were removed', () => {
    const without = { ...graph, vertices: graph.vertices.map((it, index) => ({ ...it, removed: index === 1 })) }
    expect(new TrafficCounter(without).count([heading(at(5, 1, 0), at(10, 1, 0))]).size).toBe(0)
  })
})
