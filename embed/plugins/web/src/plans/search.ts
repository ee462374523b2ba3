// The cheapest path between vertices: A*, on plain numbers. It knows neither places nor plans.

import { Heap } from './heap.ts'

/** Rounding may lift a lower bound slightly above the true cost. */
const ROUNDING = 1 + 1e-9

/** A vertex at an end of a path, and the cost of the leg that joins it to the start or goal. */
export interface Attachment {
  vertex: number
  cost: number
}

/** An edge that leaves a vertex. */
export interface Hop {
  to: number
  /** Index of the edge in the graph. */
  edge: number
}

export interface Problem {
  /** Edges that leave each vertex. */
  outgoing: readonly (readonly Hop[])[]
  starts: readonly Attachment[]
  goals: readonly Attachment[]
  /** The cost of an edge; infinite for one that must not be used. */
  costOf: (edge: number) => number
  /** A lower bound on the cost from a vertex to the goal; 0 makes this Dijkstra's search. */
  bound: (vertex: number) => number
}

export interface Path {
  /** The cost, attachments included. */
  cost: number
  first: number
  /** Indices of edges, in order. */
  edges: number[]
}

/** The cheapest path from any of the starts to any of the goals; undefined if there is none. */
export function findPath({ outgoing, starts, goals, costOf, bound }: Problem): Path | undefined {
  const cost = new Float64Array(outgoing.length).fill(Infinity)
  const isClosed = new Uint8Array(outgoing.length)
  const cameBy = new Map<number, { from: number; edge: number }>()
  const exits = new Map(goals.map(({ vertex, cost }) => [vertex, cost]))
  const open = new Heap()
  for (const start of starts) {
    if (start.cost >= cost[start.vertex]!) continue
    cost[start.vertex] = start.cost
    open.push(start.cost + bound(start.vertex), start.vertex)
  }
  let best: { cost: number; last: number } | undefined
  for (let top = open.pop(); top !== undefined; top = open.pop()) {
    const [least, vertex] = top
    if (best !== undefined && least > best.cost * ROUNDING) break
    if (isClosed[vertex] === 1) continue
    isClosed[vertex] = 1
    const whole = cost[vertex]! + (exits.get(vertex) ?? Infinity)
    if (whole < (best?.cost ?? Infinity)) best = { cost: whole, last: vertex }
    for (const { to, edge } of outgoing[vertex]!) {
      const next = cost[vertex]! + costOf(edge)
      if (next >= cost[to]!) continue
      cost[to] = next
      isClosed[to] = 0
      cameBy.set(to, { from: vertex, edge })
      open.push(next + bound(to), to)
    }
  }
  return best === undefined ? undefined : trace(best, cameBy)
}

function trace(
  { cost, last }: { cost: number; last: number },
  cameBy: ReadonlyMap<number, { from: number; edge: number }>,
): Path {
  const edges: number[] = []
  let first = last
  for (let step = cameBy.get(first); step !== undefined; step = cameBy.get(first)) {
    edges.push(step.edge)
    first = step.from
  }
  return { cost, first, edges: edges.reverse() }
}

/** The vertices that paths lead to from some, themselves included. */
export function reachedFrom(
  outgoing: readonly (readonly Hop[])[],
  from: readonly number[],
  isOpen: (edge: number) => boolean,
): Set<number> {
  const reached = new Set(from)
  const waiting = [...reached]
  for (let vertex = waiting.pop(); vertex !== undefined; vertex = waiting.pop()) {
    for (const { to, edge } of outgoing[vertex]!) {
      if (reached.has(to) || !isOpen(edge)) continue
      reached.add(to)
      waiting.push(to)
    }
  }
  return reached
}
