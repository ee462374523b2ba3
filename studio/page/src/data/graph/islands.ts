// What of a directed graph leads where: its islands, the traps among them, and edges without a way back.
//
// An island is a strongly connected component: from each of its vertices there is a way to every other of them.

import type { GetGraphResponse } from '../../gen/surefoot/planner/v1/planner_pb'
import type { Graph, Place } from '../../view/viewport.types'

/** How an island lies to the main one, which has the most vertices. */
export type Standing =
  /** The main island itself. */
  | 'main'
  /** The main island leads there, but there is no way back. */
  | 'trap'
  /** It leads to the main island, which does not lead there. */
  | 'source'
  /** No path in either direction. */
  | 'apart'

export interface Island {
  id: number
  vertices: number[]
  standing: Standing
  /** Edges that lead in from elsewhere. */
  entrances: { from: number; to: number }[]
  /** Islands that it leads to directly. */
  leadsTo: number[]
}

/** All islands, the largest first; ties by id. Vertices that were taken out belong to none. */
export function islandsOf(
  membership: readonly number[],
  edges: readonly { from: number; to: number }[],
  removed: readonly number[] = [],
): Island[] {
  const gone = new Set(removed)
  const islands = new Map<number, Island>()
  membership.forEach((id, vertex) => {
    if (gone.has(vertex)) return
    const island = islands.get(id) ?? { id, vertices: [], standing: 'apart', entrances: [], leadsTo: [] }
    island.vertices.push(vertex)
    islands.set(id, island)
  })
  const out = new Map<number, Set<number>>()
  const back = new Map<number, Set<number>>()
  for (const { from, to } of edges) {
    const [a, b] = [membership[from], membership[to]]
    if (a === undefined || b === undefined || a === b) continue
    islands.get(b)?.entrances.push({ from, to })
    link(out, a, b)
    link(back, b, a)
  }
  const sorted = [...islands.values()].sort((a, b) => b.vertices.length - a.vertices.length || a.id - b.id)
  const main = sorted[0]
  if (main === undefined) return []
  const [reached, leading] = [reachable(out, main.id), reachable(back, main.id)]
  for (const island of sorted) {
    island.leadsTo = [...(out.get(island.id) ?? [])]
    island.standing = standing(island === main, reached.has(island.id), leading.has(island.id))
  }
  return sorted
}

function standing(isMain: boolean, reached: boolean, leading: boolean): Standing {
  if (isMain) return 'main'
  // Both would make it part of the main island.
  if (reached) return 'trap'
  return leading ? 'source' : 'apart'
}

/** Adds a way from one vertex to another. */
export function link(links: Map<number, Set<number>>, from: number, to: number): void {
  const known = links.get(from)
  if (known === undefined) links.set(from, new Set([to]))
  else known.add(to)
}

/** The vertices that ways lead to from one of them, itself included. */
export function reachable(links: ReadonlyMap<number, ReadonlySet<number>>, start: number): Set<number> {
  const seen = new Set([start])
  const open = [start]
  for (let at = open.pop(); at !== undefined; at = open.pop()) {
    for (const next of links.get(at) ?? []) {
      if (seen.has(next)) continue
      seen.add(next)
      open.push(next)
    }
  }
  return seen
}

const ORIGIN: Place = { x: 0, y: 0, z: 0 }

/** A graph as the view shows it. */
export function graphToShow(graph: GetGraphResponse, islands: readonly Island[]): Graph {
  const traps = new Set(islands.filter(({ standing }) => standing === 'trap').map(({ id }) => id))
  const removed = new Set(graph.removed)
  const islandOf = (vertex: number) => graph.islands[vertex] ?? 0
  return {
    vertices: graph.vertices.map((position, vertex) => ({
      position: position ?? ORIGIN,
      island: islandOf(vertex),
      trap: traps.has(islandOf(vertex)),
      removed: removed.has(vertex),
    })),
    edges: graph.edges.map((edge) => ({
      from: edge.from,
      to: edge.to,
      ability: edge.ability,
      chance: edge.chance,
      seconds: edge.seconds,
      priceFactor: edge.priceFactor || 1,
      forced: edge.forced,
      // A way back would put both ends on one island.
      oneWay: islandOf(edge.from) !== islandOf(edge.to),
    })),
  }
}
