// What an import made of the nodes of a level: counted, listed, and found on the map.

import { type GeometryCounts, type ImportedNode, NodeRole } from '../../gen/surefoot/world/v1/maps_pb'
import type { Box } from '../../view/viewport.types'
import { count, counted } from '../format'
import { type Frame, toMap } from './marks'

/** What one node and several nodes became. */
const ROLES: Readonly<Record<NodeRole, readonly [one: string, many: string]>> = {
  [NodeRole.UNSPECIFIED]: ['unknown', 'unknown'],
  [NodeRole.SOLID]: ['solid', 'solid'],
  [NodeRole.WATER]: ['water', 'water'],
  [NodeRole.LAVA]: ['lava', 'lava'],
  [NodeRole.PAD]: ['jump pad', 'jump pads'],
  [NodeRole.ZIP_LINE]: ['end of a zip line', 'ends of zip lines'],
  [NodeRole.TELEPORTER]: ['end of a teleporter', 'ends of teleporters'],
  [NodeRole.JETPACK]: ['jetpack', 'jetpacks'],
  [NodeRole.DOOR]: ['door', 'doors'],
  [NodeRole.LIFT]: ['lift', 'lifts'],
  [NodeRole.PLATFORM]: ['platform', 'platforms'],
  [NodeRole.FLOOR]: ['floor that vanishes', 'floors that vanish'],
  [NodeRole.CONVEYOR]: ['conveyor', 'conveyors'],
  [NodeRole.CRATE]: ['crate', 'crates'],
  [NodeRole.LADDER]: ['ladder', 'ladders'],
  [NodeRole.CLIMB]: ['wall to climb', 'walls to climb'],
  [NodeRole.SPOT]: ['spot for moves', 'spots for moves'],
  [NodeRole.PATH]: ['stop of a path', 'stops of paths'],
  [NodeRole.HELPER]: ['helper', 'helpers'],
  [NodeRole.LEFT_OUT]: ['left out', 'left out'],
  [NodeRole.EMPTY]: ['empty', 'empty'],
}

export function roleName(role: NodeRole, number = 1): string {
  // A newer server may know more roles.
  return (ROLES[role] ?? ROLES[NodeRole.UNSPECIFIED])[number === 1 ? 0 : 1]
}

/** Roles that nodes have, with the number of their nodes. */
export function roleCounts(nodes: readonly ImportedNode[]): (readonly [role: NodeRole, number: number])[] {
  const numbers = new Map<NodeRole, number>()
  for (const { role } of nodes) numbers.set(role, (numbers.get(role) ?? 0) + 1)
  return [...numbers].sort(([a], [b]) => a - b)
}

/** "41 nodes: 30 solid, 4 water, 2 doors, 2 left out". */
export function summaryOf(nodes: readonly ImportedNode[]): string {
  const roles = roleCounts(nodes).map(([role, number]) => `${count(number)} ${roleName(role, number)}`)
  return [counted(nodes.length, 'node'), roles.join(', ')].filter((part) => part !== '').join(': ')
}

/** Counts of a level's geometry that are not zero. */
export function geometryRows(geometry: GeometryCounts | undefined): (readonly [name: string, value: string])[] {
  const rows: readonly (readonly [name: string, number: bigint | undefined])[] = [
    ['Solid triangles', geometry?.triangles],
    ['Without area', geometry?.degenerate],
    ['Points and lines', geometry?.pointsAndLines],
    ['Open edges', geometry?.openEdges],
    ['Crowded edges', geometry?.crowdedEdges],
    ['Inconsistent edges', geometry?.inconsistentEdges],
    ['Shells turned', geometry?.turnedShells],
    ['Triangles turned', geometry?.turnedTriangles],
    ['Made into plates', geometry?.plates],
  ]
  return rows.flatMap(([name, number]) => (number ? [[name, count(number)] as const] : []))
}

export function nodeName({ name, index }: Pick<ImportedNode, 'name' | 'index'>): string {
  return name === '' ? `node ${index}` : name
}

/** At most so many characters of a text. */
export function cut(text: string, most: number): string {
  const characters = Array.from(text.slice(0, 2 * most + 2))
  return characters.length <= most ? text : `${characters.slice(0, most - 1).join('')}…`
}

/**
 * Nodes in the order of the list: first what became something else than solid, last what became nothing.
 * Nodes of an earlier report stay where they were there, so that a line does not move while it is switched.
 */
export function inOrder(nodes: readonly ImportedNode[], earlier: readonly ImportedNode[] = []): ImportedNode[] {
  const places = new Map(earlier.map(({ index }, place) => [index, place]))
  const rank = ({ role }: ImportedNode) => (role === NodeRole.SOLID ? 1 : role === NodeRole.EMPTY ? 2 : 0)
  const placeOf = (node: ImportedNode) => places.get(node.index) ?? earlier.length + rank(node)
  return [...nodes].sort((a, b) => placeOf(a) - placeOf(b))
}

/** Which lines of the report are wanted. */
export interface NodeFilter {
  /** Part of the name. */
  text: string
  /** Undefined: any. */
  role: NodeRole | undefined
}

/** Nodes that a filter lets through. The selected one stays: its line holds the control that changes its role. */
export function findNodes(
  nodes: readonly ImportedNode[],
  { text, role }: NodeFilter,
  selected: number | undefined,
): ImportedNode[] {
  const part = text.trim().toLowerCase()
  const isWanted = (node: ImportedNode) =>
    (role === undefined || node.role === role) && nodeName(node).toLowerCase().includes(part)
  return nodes.filter((node) => node.index === selected || isWanted(node))
}

/** The box of a node on the map; undefined: the node has no triangles. */
export function boxOnMap({ low, high }: Pick<ImportedNode, 'low' | 'high'>, frame: Frame): Box | undefined {
  if (low === undefined || high === undefined) return undefined
  const [a, b] = [toMap([low.x, low.y, low.z], frame), toMap([high.x, high.y, high.z], frame)]
  return {
    low: { x: Math.min(a.x, b.x), y: Math.min(a.y, b.y), z: Math.min(a.z, b.z) },
    high: { x: Math.max(a.x, b.x), y: Math.max(a.y, b.y), z: Math.max(a.z, b.z) },
  }
}
