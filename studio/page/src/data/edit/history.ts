// What this page has done to layers, to be undone and done again.

import type { Edit, Layer } from '../../gen/surefoot/planner/v1/planner_pb'
import { editKey } from './edits'

/** One thing that was done. */
export type Step =
  | { kind: 'append'; layer: string; edits: Edit[] }
  /** A layer was put in place of another one. */
  | { kind: 'put'; layer: string; before: Edit[]; after: Edit[] }

export interface History {
  done: readonly Step[]
  undone: readonly Step[]
}

export const NOTHING_DONE: History = { done: [], undone: [] }

/** Steps that are kept. */
const MAX_STEPS = 500

/** Something new was done: what was undone before cannot be done again. */
export function withStep(history: History, step: Step): History {
  return { done: [...history.done, step].slice(-MAX_STEPS), undone: [] }
}

/** The last step was undone. */
export function afterUndo({ done, undone }: History): History {
  const last = done.at(-1)
  return last === undefined ? { done, undone } : { done: done.slice(0, -1), undone: [...undone, last] }
}

/** The step undone last was done again. */
export function afterRedo({ done, undone }: History): History {
  const last = undone.at(-1)
  return last === undefined ? { done, undone } : { done: [...done, last], undone: undone.slice(0, -1) }
}

/** The last step cannot be undone any more. */
export function withoutLast({ done, undone }: History): History {
  return { done: done.slice(0, -1), undone }
}

/** Whether the layers still end with what the step did to them. */
export function canUndo(step: Step, layers: readonly Layer[]): boolean {
  const edits = editsOf(layers, step.layer)
  if (step.kind === 'append') return endsWith(edits, step.edits)
  return sameEdits(edits, step.after)
}

/** Whether a step can be done again: always for an edit, for a whole layer only if it is unchanged since. */
export function canRedo(step: Step, layers: readonly Layer[]): boolean {
  return step.kind === 'append' || sameEdits(editsOf(layers, step.layer), step.before)
}

export function editsOf(layers: readonly Layer[], name: string): Edit[] {
  return layers.find((layer) => layer.name === name)?.edits ?? []
}

/** Whether the planner took edits that were sent for a layer of `before`, though its answer never came. */
export function wasTaken(edits: readonly Edit[], before: readonly Edit[], now: readonly Edit[]): boolean {
  const after = [...before, ...edits]
  if (sameEdits(now.slice(0, after.length), after)) return true
  return endsWith(now, edits) && !endsWith(before, edits)
}

function endsWith(edits: readonly Edit[], last: readonly Edit[]): boolean {
  return sameEdits(edits.slice(Math.max(0, edits.length - last.length)), last)
}

function sameEdits(a: readonly Edit[], b: readonly Edit[]): boolean {
  return a.length === b.length && a.map(editKey).join(';') === b.map(editKey).join(';')
}
