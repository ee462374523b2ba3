// How many NPCs are on their way along each edge of a graph.

import type { Graph, Place, Traffic } from '../../view/viewport.types'

/** An NPC with the waypoint that it heads for. */
interface Walker {
  position?: Place | undefined
  waypoint?: Place | undefined
}

/** A waypoint nearer to a vertex than this is that vertex, m. */
const SAME_M = 0.3
/** An NPC farther from an edge than this is on its way to the graph, m. */
const BESIDE_M = 8

const cellOf = (at: number): number => Math.floor(at)

/** Finds the edges that NPCs are on. */
export class TrafficCounter {
  /** Vertices by the square metre they stand on. */
  private readonly vertices = new Map<string, number[]>()
  /** The edges to each vertex. */
  private readonly entries = new Map<number, { from: number; to: number }[]>()

  constructor(private readonly graph: Graph) {
    graph.vertices.forEach(({ position, removed }, index) => {
      if (removed !== true) append(this.vertices, `${cellOf(position.x)} ${cellOf(position.z)}`, index)
    })
    for (const { from, to } of graph.edges) append(this.entries, to, { from, to })
  }

  /** NPCs on each edge; who heads for no vertex, or is far from all edges to it, is on none. */
  count(npcs: Iterable<Walker>): Traffic {
    const traffic = new Map<string, number>()
    for (const { position, waypoint } of npcs) {
      const to = waypoint && this.vertexAt(waypoint)
      const edge = position && to !== undefined ? this.edgeBeside(position, to) : undefined
      if (edge !== undefined) traffic.set(edge, (traffic.get(edge) ?? 0) + 1)
    }
    return traffic
  }

  private vertexAt(place: Place): number | undefined {
    for (let x = cellOf(place.x - SAME_M); x <= cellOf(place.x + SAME_M); x += 1) {
      for (let z = cellOf(place.z - SAME_M); z <= cellOf(place.z + SAME_M); z += 1) {
        const found = this.vertices.get(`${x} ${z}`)?.find((index) => distance(this.place(index), place) < SAME_M)
        if (found !== undefined) return found
      }
    }
    return undefined
  }

  private edgeBeside(place: Place, vertex: number): string | undefined {
    let best = { aside: BESIDE_M, key: undefined as string | undefined }
    for (const { from, to } of this.entries.get(vertex) ?? []) {
      const aside = distanceToLine(place, this.place(from), this.place(to))
      if (aside < best.aside) best = { aside, key: `${from}>${to}` }
    }
    return best.key
  }

  private place(vertex: number): Place {
    return this.graph.vertices[vertex]!.position
  }
}

function append<Key, Value>(lists: Map<Key, Value[]>, key: Key, value: Value): void {
  const list = lists.get(key)
  if (list === undefined) lists.set(key, [value])
  else list.push(value)
}

function distance(a: Place, b: Place): number {
  return Math.hypot(a.x - b.x, a.y - b.y, a.z - b.z)
}

function distanceToLine(point: Place, from: Place, to: Place): number {
  const along = { x: to.x - from.x, y: to.y - from.y, z: to.z - from.z }
  const length = along.x ** 2 + along.y ** 2 + along.z ** 2
  const dot = (point.x - from.x) * along.x + (point.y - from.y) * along.y + (point.z - from.z) * along.z
  const share = length === 0 ? 0 : Math.min(1, Math.max(0, dot / length))
  return distance(point, { x: from.x + along.x * share, y: from.y + along.y * share, z: from.z + along.z * share })
}
