// The planner's graphs, to choose from.

import { Placement, type ReadyGraph } from '../../gen/surefoot/planner/v1/planner_pb'
import { placementName } from '../abilities'
import { shortId } from '../format'
import { RANGES } from './builds'

/** What tells a graph from others: "seed 42 · spaced 300 x 12 · 2a4c81f0". */
export function graphLabel(graph: ReadyGraph): string {
  const { settings, summary } = graph
  const level = graph.map === undefined ? graph.level || 'imported level' : `seed ${graph.map.seed}`
  const placement = placementName(settings?.placement ?? Placement.SPACED).toLowerCase()
  const vertices = summary?.vertices ?? settings?.vertices ?? RANGES.vertices.standard
  const neighbours = settings?.neighbours || RANGES.neighbours.standard
  return `${level} · ${placement} ${vertices} x ${neighbours} · ${shortId(graph.graphId)}`
}

/** The first of the wanted graphs that is there, else any; empty if there are none. */
export function pickGraph(list: readonly ReadyGraph[], wanted: readonly (string | undefined)[]): string {
  return wanted.find((id) => list.some(({ graphId }) => graphId === id)) ?? list[0]?.graphId ?? ''
}

/** What one would compare a graph with: one of the same map if possible, else of the same level, else any other. */
export function relativeOf(list: readonly ReadyGraph[], id: string): string | undefined {
  const graph = list.find(({ graphId }) => graphId === id)
  const others = list.filter(({ graphId }) => graphId !== id)
  const relative =
    others.find(({ summary }) => summary?.mapHash === graph?.summary?.mapHash) ??
    others.find(({ level, map }) => map === undefined && level !== '' && level === graph?.level) ??
    others[0]
  return relative?.graphId
}
