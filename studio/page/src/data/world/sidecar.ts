// The sidecar of a level, `level.surefoot.json`: read, changed and written. What a change does not name stays as it is.

/** What the sidecar can say that a node is. */
export const NODE_KINDS = [
  { value: 'solid', name: 'Solid' },
  { value: 'water', name: 'Water' },
  { value: 'lava', name: 'Lava' },
  { value: 'door', name: 'Door' },
  { value: 'leave_out', name: 'Left out' },
  { value: 'pad', name: 'Jump pad' },
  { value: 'jetpack', name: 'Jetpack' },
  { value: 'lift', name: 'Lift' },
  { value: 'platform', name: 'Platform' },
  { value: 'floor', name: 'Floor that vanishes' },
  { value: 'crate', name: 'Crate' },
  { value: 'ladder', name: 'Ladder' },
  { value: 'climb', name: 'Wall to climb' },
  { value: 'anchor', name: 'Anchor' },
  { value: 'spawn', name: 'Spawn point' },
] as const

export type NodeKind = (typeof NODE_KINDS)[number]['value']

/** The parts of the file that the page changes. */
export interface Sidecar {
  pools?: unknown[]
  pads?: unknown[]
  zip_lines?: unknown[]
  teleporters?: unknown[]
  jetpacks?: unknown[]
  anchors?: unknown[]
  spawns?: unknown[]
  /** What nodes are, by exact name or by pattern. */
  nodes?: Record<string, NodeKind>
  /** False: names have no meaning. */
  names?: boolean
}

/** The content of a file; an empty one lists nothing. @throws SyntaxError if it is not JSON. */
export function readSidecar(text: string): Sidecar {
  return text.trim() === '' ? {} : (JSON.parse(text) as Sidecar)
}

export function writeSidecar(sidecar: Sidecar): string {
  return `${JSON.stringify(sidecar, undefined, 1)}\n`
}

/** Why the sidecar cannot refer to a node of this name; undefined: it can. */
export function nameFault(name: string): string | undefined {
  const cure = 'in the modelling tool to switch it here.'
  if (name === '') return `This node has no name: give it one ${cure}`
  const isPattern = name.startsWith('*') || name.endsWith('*')
  return isPattern ? `A name with * at an end is a pattern to the sidecar: rename the node ${cure}` : undefined
}

/** What the sidecar says that the node of exactly this name is. Case does not matter. */
export function kindOf({ nodes = {} }: Sidecar, name: string): NodeKind | undefined {
  return Object.entries(nodes).find(([key]) => isSame(key, name))?.[1]
}

/** Says what the node of exactly this name is; undefined takes back what was said. */
export function withKind(sidecar: Sidecar, name: string, kind: NodeKind | undefined): Sidecar {
  const { nodes = {}, ...others } = sidecar
  const kept = Object.entries(nodes).filter(([key]) => !isSame(key, name))
  const entries = kind === undefined ? kept : [...kept, [name, kind] as const]
  // Not by assignment: a node may be called __proto__.
  return entries.length === 0 ? others : { ...others, nodes: Object.fromEntries(entries) }
}

/** Says whether names of nodes have a meaning, as they have unless the file denies it. */
export function withNames(sidecar: Sidecar, haveMeaning: boolean): Sidecar {
  const { names: _, ...others } = sidecar
  return haveMeaning ? others : { ...others, names: false }
}

const isSame = (key: string, name: string): boolean => key.toLowerCase() === name.toLowerCase()
