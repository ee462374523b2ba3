// What changed between two states of a level's layers.

import type { Edit, Layer } from '../../gen/surefoot/planner/v1/planner_pb'
import { counted } from '../format'
import { editKey } from './edits'

export interface LayerChange {
  layer: string
  added: Edit[]
  removed: Edit[]
  /** Whether the layer came to be, went, stayed, or only has its edits in another order. */
  kind: 'new' | 'gone' | 'changed' | 'reordered'
}

/** The layers that differ, by name. */
export function differenceOf(before: readonly Layer[], after: readonly Layer[]): LayerChange[] {
  const names = new Set([...before, ...after].map(({ name }) => name))
  const changes: LayerChange[] = []
  for (const name of [...names].sort()) {
    const [old, now] = [find(before, name), find(after, name)]
    const added = without(now?.edits ?? [], old?.edits ?? [])
    const removed = without(old?.edits ?? [], now?.edits ?? [])
    if (old === undefined || now === undefined) {
      changes.push({ layer: name, added, removed, kind: old === undefined ? 'new' : 'gone' })
    } else if (added.length > 0 || removed.length > 0) {
      changes.push({ layer: name, added, removed, kind: 'changed' })
    } else if (!sameOrder(old, now)) {
      changes.push({ layer: name, added, removed, kind: 'reordered' })
    }
  }
  return changes
}

/** "Layer night changed elsewhere: +2 edits, -1 edit". */
export function changeInWords({ layer, added, removed, kind }: LayerChange): string {
  if (kind === 'gone') return `Layer ${layer} was deleted elsewhere`
  if (kind === 'reordered') return `Layer ${layer} was put in another order elsewhere`
  const parts = [
    added.length > 0 ? `+${counted(added.length, 'edit')}` : '',
    removed.length > 0 ? `-${counted(removed.length, 'edit')}` : '',
  ].filter((part) => part !== '')
  const what = kind === 'new' ? 'was made elsewhere' : 'changed elsewhere'
  return parts.length === 0 ? `Layer ${layer} ${what}` : `Layer ${layer} ${what}: ${parts.join(', ')}`
}

function find(layers: readonly Layer[], name: string): Layer | undefined {
  return layers.find((layer) => layer.name === name)
}

/** The edits that are left of `edits` when each of `others` takes one equal to it away. */
function without(edits: readonly Edit[], others: readonly Edit[]): Edit[] {
  const spent = new Map<string, number>()
  for (const edit of others) spent.set(editKey(edit), (spent.get(editKey(edit)) ?? 0) + 1)
  return edits.filter((edit) => {
    const left = spent.get(editKey(edit)) ?? 0
    spent.set(editKey(edit), left - 1)
    return left <= 0
  })
}

function sameOrder(a: Layer, b: Layer): boolean {
  return a.edits.every((edit, index) => {
    const other = b.edits[index]
    return other !== undefined && editKey(edit) === editKey(other)
  })
}
