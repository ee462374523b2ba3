// Edits of a graph: how they are made, compared and put into words.

import { create, equals, toBinary } from '@bufbuild/protobuf'
import { type Edit, EditSchema, type Layer } from '../../gen/surefoot/planner/v1/planner_pb'
import type { EditMark, Place } from '../../view/viewport.types'
import { factor, place } from '../format'

/** A place as it comes back from the planner: in single precision. */
function single({ x, y, z }: Place): Place {
  return { x: Math.fround(x), y: Math.fround(y), z: Math.fround(z) }
}

export function forbidEdge(from: Place, to: Place): Edit {
  return create(EditSchema, { edit: { case: 'forbidEdge', value: { from: single(from), to: single(to) } } })
}

export function forceEdge(from: Place, to: Place): Edit {
  return create(EditSchema, { edit: { case: 'forceEdge', value: { from: single(from), to: single(to) } } })
}

/** What the planner takes as a factor. */
const [LEAST_FACTOR, MOST_FACTOR] = [0.1, 1000]

export function priceEdge(from: Place, to: Place, by: number): Edit {
  // Rounded to single precision it must not fall below what the planner takes, which compares the same way.
  const factor = Math.fround(Math.min(MOST_FACTOR, Math.max(LEAST_FACTOR, by)))
  const value = { from: single(from), to: single(to), factor }
  return create(EditSchema, { edit: { case: 'priceEdge', value } })
}

/** Edits that together make a price `wanted` times what it was from `present` times: they multiply, each within limits. */
export function priceEdits(from: Place, to: Place, present: number, wanted: number): Edit[] {
  const ratio = wanted / present
  const limit = ratio < 1 ? LEAST_FACTOR : MOST_FACTOR
  // Logarithms of powers of ten come out a little off.
  const parts = Math.max(1, Math.ceil(Math.log(ratio) / Math.log(limit) - 1e-6))
  return Array.from({ length: parts }, () => priceEdge(from, to, ratio ** (1 / parts)))
}

export function addVertex(at: Place): Edit {
  return create(EditSchema, { edit: { case: 'addVertex', value: { at: single(at) } } })
}

export function moveVertex(from: Place, to: Place): Edit {
  return create(EditSchema, { edit: { case: 'moveVertex', value: { from: single(from), to: single(to) } } })
}

export function removeVertex(at: Place): Edit {
  return create(EditSchema, { edit: { case: 'removeVertex', value: { at: single(at) } } })
}

export function sameEdit(a: Edit | undefined, b: Edit | undefined): boolean {
  return a !== undefined && b !== undefined && equals(EditSchema, a, b)
}

/** Equal for equal edits. */
export function editKey(edit: Edit): string {
  return toBinary(EditSchema, edit).join(',')
}

/** What an edit does, in words: "Forbid 31, 12, 40 to 45, 12, 38". */
export function describe({ edit }: Edit): string {
  switch (edit.case) {
    case 'forbidEdge':
      return `Forbid ${place(edit.value.from)} to ${place(edit.value.to)}`
    case 'forceEdge': {
      const seconds = edit.value.seconds === undefined ? '' : ` (${edit.value.seconds} s)`
      return `Force ${place(edit.value.from)} to ${place(edit.value.to)}${seconds}`
    }
    case 'priceEdge':
      return `Price ${factor(edit.value.factor)}: ${place(edit.value.from)} to ${place(edit.value.to)}`
    case 'addVertex':
      return `Add vertex at ${place(edit.value.at)}`
    case 'moveVertex':
      return `Move vertex ${place(edit.value.from)} to ${place(edit.value.to)}`
    case 'removeVertex':
      return `Remove vertex at ${place(edit.value.at)}`
    default:
      return 'An edit that this page does not know'
  }
}

/** A place to look at for an edit. */
export function whereIs({ edit }: Edit): Place | undefined {
  switch (edit.case) {
    case 'forbidEdge':
    case 'forceEdge':
    case 'priceEdge': {
      const { from, to } = edit.value
      if (from === undefined || to === undefined) return from ?? to
      return { x: (from.x + to.x) / 2, y: (from.y + to.y) / 2, z: (from.z + to.z) / 2 }
    }
    case 'moveVertex':
      return edit.value.to
    case 'addVertex':
    case 'removeVertex':
      return edit.value.at
    default:
      return undefined
  }
}

/** Marks for what edits took out of the graph; those that did not fit took nothing out. */
export function marksOf(layers: readonly Layer[], isUnfit: (layer: string, index: number) => boolean): EditMark[] {
  const marks: EditMark[] = []
  for (const layer of layers) {
    layer.edits.forEach(({ edit }, index) => {
      if (isUnfit(layer.name, index)) return
      if (edit.case === 'forbidEdge' && edit.value.from !== undefined) {
        marks.push({ kind: 'forbidden', from: edit.value.from, to: edit.value.to })
      }
      if (edit.case === 'removeVertex' && edit.value.at !== undefined) {
        marks.push({ kind: 'removed', from: edit.value.at })
      }
    })
  }
  return marks
}
