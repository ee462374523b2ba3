// The layers of edits that lie over the graph: read, changed, and kept from losing anybody's work.
//
// Whatever changes or reads layers waits for what was begun before it. A change is sent for the revision that this page
// knows; if somebody was quicker, the planner refuses it, and it is held until the designer has decided.

import { create } from '@bufbuild/protobuf'
import { batch, computed, signal } from '@preact/signals'
import { type Edit, type Layer, LayerSchema, type UnfitEdit } from '../../gen/surefoot/planner/v1/planner_pb'
import { type Context, report, reportEdit } from '../context'
import { failureOf, inWords } from '../net/errors'
import { changeInWords, differenceOf, type LayerChange } from './difference'
import { describe, sameEdit } from './edits'
import {
  afterRedo,
  afterUndo,
  canRedo,
  canUndo,
  editsOf,
  type History,
  NOTHING_DONE,
  type Step,
  withoutLast,
  withStep,
} from './history'

const KEPT_AS = 'surefoot.layer'
const FIRST_LAYER = 'studio'

/** An edit with the layer that it is meant for. */
interface Held {
  layer: string
  edit: Edit
}

/** Edits that were not applied, because somebody else changed the layers first or the planner did not take them. */
export interface Conflict {
  /** For people. */
  why: string
  held: Held[]
  changes: LayerChange[]
}

/** What the planner says a change has led to. */
interface Changed {
  unfit: UnfitEdit[]
  revision: bigint
}

export class Layers {
  readonly list = signal<readonly Layer[]>([])
  readonly unfit = signal<readonly UnfitEdit[]>([])
  readonly active = signal(FIRST_LAYER)
  readonly history = signal<History>(NOTHING_DONE)
  readonly conflict = signal<Conflict | undefined>(undefined)
  /** Changes that are on their way. */
  readonly saving = signal(0)
  /** Why layers cannot be read; empty: they can. */
  readonly failure = signal('')

  readonly canUndo = computed(() => this.history.value.done.length > 0)
  readonly canRedo = computed(() => this.history.value.undone.length > 0)
  private graphId: string | undefined
  private mapHash: string | undefined
  private revision: bigint | undefined
  private queue: Promise<unknown> = Promise.resolve()

  constructor(
    private readonly context: Context,
    /** Called after this page has changed layers. */
    private readonly onChange: () => void,
  ) {
    this.active.value = context.store?.getItem(KEPT_AS) ?? FIRST_LAYER
  }

  unfitReason(layer: string, index: number): string | undefined {
    return this.unfit.value.find((unfit) => unfit.layer === layer && unfit.index === index)?.reason
  }

  setActive(name: string): void {
    this.active.value = name
    this.context.store?.setItem(KEPT_AS, name)
  }

  /** A graph was loaded with layers of this revision: reads them if they are other ones. */
  sync({ id, revision, mapHash }: { id: string; revision: bigint; mapHash: string }): void {
    void this.enqueue(async () => {
      const isOther = id !== this.graphId
      if (!isOther && revision === this.revision) return
      const before = this.list.peek()
      this.graphId = id
      if (mapHash !== this.mapHash) this.forgetSteps(mapHash)
      await this.read()
      if (isOther) return
      for (const change of differenceOf(before, this.list.peek())) this.context.toasts.say(changeInWords(change))
    })
  }

  /** The world is left. What was done stays known until there is another map: a server that begins anew has the same. */
  forget(): void {
    void this.enqueue(async () => {
      this.graphId = undefined
      this.revision = undefined
      batch(() => {
        this.list.value = []
        this.unfit.value = []
      })
    })
  }

  private forgetSteps(mapHash: string): void {
    this.mapHash = mapHash
    batch(() => {
      this.history.value = NOTHING_DONE
      this.conflict.value = undefined
    })
  }

  /** Adds an edit to the active layer. */
  apply(edit: Edit): Promise<void> {
    const layer = this.active.peek()
    return this.enqueue(async () => {
      const conflict = this.conflict.peek()
      if (conflict !== undefined) {
        this.conflict.value = { ...conflict, held: [...conflict.held, { layer, edit }] }
        this.context.toasts.say('Decide about the conflict first: the edit is held until then.')
        return
      }
      await this.append(layer, edit)
    })
  }

  /** Applies the edits of a conflict to the layers as they are now. */
  applyOnTop(): Promise<void> {
    return this.enqueue(async () => {
      const held = this.conflict.peek()?.held ?? []
      this.conflict.value = undefined
      for (const [index, step] of held.entries()) {
        await this.append(step.layer, step.edit)
        const again = this.conflict.peek() as Conflict | undefined
        if (again === undefined) continue
        // It is held again, and those behind it with it.
        this.conflict.value = { ...again, held: held.slice(index) }
        return
      }
    })
  }

  discardConflict(): void {
    this.conflict.value = undefined
  }

  undo(): Promise<void> {
    return this.enqueue(() => this.stepBack())
  }

  redo(): Promise<void> {
    return this.enqueue(() => this.stepForth())
  }

  /** Takes one edit out of a layer. */
  removeEdit(name: string, index: number, edit: Edit): Promise<void> {
    return this.enqueue(async () => {
      const before = editsOf(this.list.peek(), name)
      if (!sameEdit(before[index], edit)) {
        return this.context.toasts.say(`The edit was not deleted: layer ${name} has changed meanwhile.`, 'bad')
      }
      await this.put(
        name,
        before.filter((_, at) => at !== index),
      )
    })
  }

  /** Deletes a layer with all its edits. */
  deleteLayer(name: string): Promise<void> {
    return this.enqueue(() => this.put(name, []))
  }

  private enqueue(work: () => Promise<unknown>): Promise<void> {
    const done = this.queue.then(work).then(
      () => undefined,
      (error: unknown) => report(this.context, 'Layers', error),
    )
    this.queue = done
    return done
  }

  private async read(): Promise<void> {
    const graphId = this.graphId
    if (graphId === undefined) return
    try {
      const { layers, unfit, revision } = await this.context.planner.calls.getLayers({ graphId })
      this.revision = revision
      batch(() => {
        this.list.value = layers
        this.unfit.value = unfit
        this.failure.value = ''
      })
    } catch (error) {
      this.failure.value = inWords(error)
      throw error
    }
  }

  /** Sends an edit. One that was not taken, though nothing is wrong with it, is held. */
  private async append(layer: string, edit: Edit): Promise<void> {
    try {
      await this.sendAppend(layer, edit)
      this.history.value = withStep(this.history.peek(), { kind: 'append', layer, edit })
      const reason = this.unfitReason(layer, editsOf(this.list.peek(), layer).length - 1)
      if (reason !== undefined) this.context.toasts.say(`The edit is kept, but changes nothing: ${reason}.`, 'bad')
    } catch (error) {
      const failure = failureOf(error)
      if (failure === 'refused' || failure === 'missing' || failure === 'unsupported') {
        return report(this.context, `Not applied: ${describe(edit)}`, error)
      }
      if (failure === 'role') reportEdit(this.context, 'Not applied', error)
      await this.hold({ layer, edit }, error)
    }
  }

  private async hold(step: Held, error: unknown): Promise<void> {
    const before = this.list.peek()
    const isOvertaken = failureOf(error) === 'changed'
    if (isOvertaken) {
      await this.read()
      this.onChange()
    }
    const why = isOvertaken ? 'Somebody else changed the layers while you were editing.' : inWords(error)
    this.conflict.value = { why, held: [step], changes: differenceOf(before, this.list.peek()) }
  }

  private async put(name: string, after: Edit[]): Promise<void> {
    const before = editsOf(this.list.peek(), name)
    try {
      await this.sendPut(name, after)
      this.history.value = withStep(this.history.peek(), { kind: 'put', layer: name, before, after })
    } catch (error) {
      await this.explain(`Layer ${name} was not changed`, error)
    }
  }

  private async stepBack(): Promise<void> {
    const step = this.history.peek().done.at(-1)
    if (step === undefined) return
    try {
      while (canUndo(step, this.list.peek())) {
        if (await this.tookBack(step)) {
          this.history.value = afterUndo(this.history.peek())
          return
        }
        // Somebody changed a layer. Unless it was this one, undoing is still right.
        await this.read()
      }
      this.cannotUndo(step)
    } catch (error) {
      reportEdit(this.context, 'Not undone', error)
    }
  }

  /** Whether a step was taken back; it was not if the layers are of another revision. */
  private async tookBack(step: Step): Promise<boolean> {
    try {
      await (step.kind === 'append' ? this.sendUndo(step.layer) : this.sendPut(step.layer, step.before))
      return true
    } catch (error) {
      if (failureOf(error) !== 'changed') throw error
      return false
    }
  }

  private cannotUndo(step: Step): void {
    this.history.value = withoutLast(this.history.peek())
    const why = step.kind === 'append' ? 'its last edit is not yours any more' : 'it has changed since'
    this.context.toasts.say(`Cannot undo in layer ${step.layer}: ${why}.`, 'bad')
  }

  private async stepForth(): Promise<void> {
    const step = this.history.peek().undone.at(-1)
    if (step === undefined) return
    if (!canRedo(step, this.list.peek())) {
      return this.context.toasts.say(`Cannot redo: layer ${step.layer} has changed since.`, 'bad')
    }
    try {
      await (step.kind === 'append' ? this.sendAppend(step.layer, step.edit) : this.sendPut(step.layer, step.after))
      this.history.value = afterRedo(this.history.peek())
    } catch (error) {
      await this.explain('Not done again', error)
    }
  }

  private async explain(what: string, error: unknown): Promise<void> {
    if (failureOf(error) !== 'changed') return reportEdit(this.context, what, error)
    await this.read()
    this.onChange()
    this.context.toasts.say(`${what}: somebody else changed the layers meanwhile. Look and try again.`, 'bad')
  }

  private sendAppend(layer: string, edit: Edit): Promise<void> {
    return this.send(layer, [...editsOf(this.list.peek(), layer), edit], (base) =>
      this.context.planner.calls.appendEdits({ ...base, layer, edits: [edit] }),
    )
  }

  private sendUndo(layer: string): Promise<void> {
    return this.send(layer, editsOf(this.list.peek(), layer).slice(0, -1), (base) =>
      this.context.planner.calls.undoEdits({ ...base, layer, count: 1 }),
    )
  }

  private sendPut(name: string, edits: Edit[]): Promise<void> {
    return this.send(name, edits, (base) =>
      this.context.planner.calls.putLayer({ ...base, layer: create(LayerSchema, { name, edits }) }),
    )
  }

  /** Sends a change for the revision that is known, and notes what the layer is after it. */
  private async send(
    name: string,
    after: Edit[],
    call: (base: { graphId: string; ifRevision: bigint }) => Promise<Changed>,
  ): Promise<void> {
    if (this.graphId === undefined || this.revision === undefined) throw new Error('There is no graph to edit yet')
    this.saving.value += 1
    try {
      const { unfit, revision } = await call({ graphId: this.graphId, ifRevision: this.revision })
      this.revision = revision
      batch(() => {
        this.list.value = withLayer(this.list.peek(), name, after)
        this.unfit.value = unfit
      })
      this.onChange()
    } finally {
      this.saving.value -= 1
    }
  }
}

/** The layers with one of them replaced, by name; one without edits is forgotten. */
export function withLayer(layers: readonly Layer[], name: string, edits: Edit[]): Layer[] {
  const others = layers.filter((layer) => layer.name !== name)
  const all = edits.length > 0 ? [...others, create(LayerSchema, { name, edits })] : others
  return all.sort((a, b) => (a.name < b.name ? -1 : 1))
}
