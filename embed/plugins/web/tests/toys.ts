// Graphs that tests make up.

import { Graph, type Vec3 } from '../src/plans/index.ts'

export interface ToyEdge {
  ability?: string
  tries?: number
  deaths?: number
}

/** The file of a graph; edges are certain and take as long as they are far, unless told otherwise. */
export function toyFile(vertices: Vec3[], edges: [from: number, to: number, more?: ToyEdge][]) {
  const link = ([from, to, { ability = 'walk', tries = 1, deaths = 0 } = {}]: (typeof edges)[number]) => {
    const [a, b] = [vertices[from]!, vertices[to]!]
    return {
      source: from,
      target: to,
      ability,
      evidence: {
        tries,
        successes: tries - deaths,
        deaths,
        decisions_sum: Math.hypot(b.x - a.x, b.y - a.y, b.z - a.z) * (tries - deaths),
        prior: 1,
        death_share: 0,
        price_factor: 1,
        needs: { list: [], ride: null },
        bounds: [
          [0, 0, 0],
          [1, 1, 1],
        ],
      },
    }
  }
  const legs = { success: [3, -0.6, 0, -1, -0.4, -0.3], decisions: [3, 13, 0, 6, 0, 1], range_m: 30, death_share: 0.1 }
  return { graph: { legs }, nodes: vertices.map((at, id) => ({ id, ...at })), edges: edges.map(link) }
}

export function toyGraph(...parts: Parameters<typeof toyFile>): Graph {
  return Graph.read(toyFile(...parts))
}

/** Four vertices in a row, 20 m apart. */
export function lineGraph(): Graph {
  const vertices = [0, 20, 40, 60].map((x) => ({ x, y: 0, z: 0 }))
  return toyGraph(vertices, [
    [0, 1],
    [1, 2],
    [2, 3],
  ])
}
