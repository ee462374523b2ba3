// What of a graph is shown, how its edges run through the air, and what colours they have. No renderer here.

import { Ability } from '../gen/surefoot/world/v1/map_pb'
import { abilityKind, lookOf } from './abilities'
import {
  abilityColour,
  BUSY_NPCS,
  chanceColour,
  islandColour,
  mixColours,
  parseColour,
  type Rgb,
  secondsColour,
  trafficColour,
} from './colours'
import type { Graph, GraphEdge, GraphFilter, Place } from './viewport.types'

/** Height over the ground, m. */
export const LIFT_M = 0.4
/** Distance of an edge from the line between its vertices, if there is one back, m. */
const SIDE_M = 0.3
/** Edges end so far from their vertices, m. */
const GAP_M = 0.45

/** Shorter ways that are walked are straight, m. */
const STRAIGHT_M = 8

/** Graphs with more edges are drawn with straight lines for what is walked. */
const MANY_EDGES = 6000

export const edgeKey = (from: number, to: number): number => from * 0x200000 + to

export function isEdited(edge: GraphEdge): boolean {
  return edge.forced || Math.abs(edge.priceFactor - 1) > 1e-6
}

export function isShown(edge: GraphEdge, filter: GraphFilter): boolean {
  return (
    filter.presence !== 'off' &&
    filter.abilities.has(abilityKind(edge.ability)) &&
    edge.chance >= filter.minChance &&
    edge.chance <= filter.maxChance &&
    (!filter.onlyOneWay || edge.oneWay) &&
    (!filter.onlyEdited || isEdited(edge))
  )
}

/** Between what seconds the colours run: up to what 19 of 20 edges keep to, so that one slow edge does not spoil it. */
export function secondsRange(graph: Graph): { low: number; high: number } {
  const seconds = Float64Array.from(graph.edges, (edge) => edge.seconds).sort()
  const low = seconds[0] ?? 0
  const high = seconds[Math.floor((seconds.length - 1) * 0.95)] ?? 1
  return { low, high: Math.max(high, low + 1e-3) }
}

const BETWEEN_ISLANDS = parseColour('#f4f6f8')

export function edgeColour(
  edge: GraphEdge,
  graph: Graph,
  colour: GraphFilter['colour'],
  { low, high, npcs }: { low: number; high: number; npcs: number },
): Rgb {
  switch (colour) {
    case 'chance':
      return chanceColour(edge.chance)
    case 'seconds':
      return secondsColour((edge.seconds - low) / (high - low))
    case 'traffic':
      return trafficColour(npcs / BUSY_NPCS)
    case 'ability':
      return abilityColour(edge.ability)
    case 'island': {
      const from = graph.vertices[edge.from]?.island
      const to = graph.vertices[edge.to]?.island
      return from !== undefined && from === to ? mixColours(islandColour(from), BETWEEN_ISLANDS, 0.15) : BETWEEN_ISLANDS
    }
  }
}

/** 'straight': ways that are walked have no arc; 'smooth': for a few bold lines. */
export type ArcDetail = 'straight' | 'usual' | 'smooth'

/** Points of an edge or a leg, from start to end, three numbers each. */
export function arc(from: Place, to: Place, ability: Ability, detail: ArcDetail = 'usual'): Float32Array {
  const length = Math.hypot(to.x - from.x, to.y - from.y, to.z - from.z)
  const { share, most, pieces } = lookOf(ability).arc
  const walked = ability === Ability.WALK && (detail === 'straight' || length < STRAIGHT_M)
  const count = walked || length < 3 ? 1 : pieces * (detail === 'smooth' ? 2 : 1)
  const height = count > 1 ? Math.min(most, length * share) : 0
  const points = new Float32Array((count + 1) * 3)
  for (let at = 0; at <= count; at += 1) {
    const t = at / count
    points[at * 3] = from.x + (to.x - from.x) * t
    points[at * 3 + 1] = from.y + (to.y - from.y) * t + LIFT_M + 4 * height * t * (1 - t)
    points[at * 3 + 2] = from.z + (to.z - from.z) * t
  }
  return points
}

/** An edge between its vertices: shortened at both ends, and to the right of the way if there is an edge back. */
export function edgePoints(from: Place, to: Place, edge: GraphEdge, paired: boolean, straight: boolean): Float32Array {
  const dx = to.x - from.x
  const dz = to.z - from.z
  const length = Math.hypot(dx, to.y - from.y, dz)
  const level = Math.hypot(dx, dz)
  const gap = length > 4 * GAP_M ? GAP_M / length : 0
  const side = paired && level > 1e-3 ? SIDE_M / level : 0
  const along = (share: number): Place => ({
    x: from.x + dx * share - dz * side,
    y: from.y + (to.y - from.y) * share,
    z: from.z + dz * share + dx * side,
  })
  return arc(along(gap), along(1 - gap), edge.ability, straight ? 'straight' : 'usual')
}

/** A point of a polyline and the way it goes there; `share` of its length from the start. */
export function pointAlong(points: Float32Array, share: number): { at: Place; towards: Place } {
  const place = (index: number): Place => ({
    x: points[index * 3]!,
    y: points[index * 3 + 1]!,
    z: points[index * 3 + 2]!,
  })
  const pieces = points.length / 3 - 1
  const piece = Math.min(pieces - 1, Math.max(0, Math.floor(share * pieces)))
  const a = place(piece)
  const b = place(piece + 1)
  const t = share * pieces - piece
  return { at: { x: a.x + (b.x - a.x) * t, y: a.y + (b.y - a.y) * t, z: a.z + (b.z - a.z) * t }, towards: b }
}

/** One edge of a graph as it is drawn and picked. */
export interface ShapedEdge {
  edge: GraphEdge
  points: Float32Array
}

/** The edges that a filter lets through, with their shapes. */
export function shapeEdges(graph: Graph, filter: GraphFilter): ShapedEdge[] {
  const known = new Set(graph.edges.map((edge) => edgeKey(edge.from, edge.to)))
  const straight = graph.edges.length > MANY_EDGES
  return graph.edges.flatMap((edge) => {
    const from = graph.vertices[edge.from]?.position
    const to = graph.vertices[edge.to]?.position
    if (!from || !to || !isShown(edge, filter)) {
      return []
    }
    return [{ edge, points: edgePoints(from, to, edge, known.has(edgeKey(edge.to, edge.from)), straight) }]
  })
}
