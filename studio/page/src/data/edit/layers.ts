// The layers of edits on top of the graph: reads and changes them without losing another user's work.
//
// Reads and changes run one after another. A change is sent for the revision that this page has; if another user was
// quicker, the planner refuses it, and the change waits until the designer has decided.

import { create } from '@bufbuild/protobuf'
import { batch, computed, signal } from '@preact/signals'
import { type Edit, type Layer, LayerSchema, type UnappliedEdit } from '../../gen/surefoot/planner/v1/planner_pb'
import { type Context, report, reportEdit } from '../context'
import { pauseAfter, sleep } from '../net/backoff'
import { type Failure, failureOf, inWords } from '../net/errors'
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
  wasTaken,
  withoutLast,
  withStep,
} from './history'

const KEPT_AS = 'surefoot.layer'
const FIRST_LAYER = 'studio'

/** Maps whose history and held edits are kept. */
const MAX_MAPS = 8
/** A planner that takes longer for an edit is not going to answer. */
const TIMED = { timeoutMs: 30_000 }
/** A graph that is missing may only not be loaded in the planner just now. */
const MAY_BE_READ_LATER: ReadonlySet<Failure> = new Set<Failure>(['gone', 'changed', 'missing', 'token'])

/** Edits that belong together, with the layer that they are meant for. */
interface Held {
  layer: string
  edits: Edit[]
  /** The layer that they were sent for, if the planner may have taken them without this page hearing of it. */
  sentOver?: Edit[] | undefined
}

/** There is nothing yet that could be edited. */
class NoGraph extends Error {
  override message = 'The graph and its layers are not loaded yet.'
}

/** Edits that were not applied, because another client changed the layers first or the planner rejected the edits. */
export interface Conflict {
  /** For people. */
  why: string
  held: Held[]
  changes: LayerChange[]
}

/** What the planner says a change has led to. */
interface Changed {
  unapplied: UnappliedEdit[]
  revision: bigint
}

export class Layers {
  readonly list = signal<readonly Layer[]>([])
  readonly unapplied = signal<readonly UnappliedEdit[]>([])
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
  private readFailures = 0
  private isReadDue = false
  private readonly ofMaps = new Map<string, { history: History; conflict: Conflict | undefined }>()

  constructor(
    private readonly context: Context,
    /** Called after this page has changed layers. */
    private readonly onChange: () => void,
  ) {
    this.active.value = context.store?.getItem(KEPT_AS) ?? FIRST_LAYER
  }

  unappliedReason(layer: string, index: number): string | undefined {
    return this.unapplied.value.find((unapplied) => unapplied.layer === layer && unapplied.index === index)?.reason
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
      if (isOther) this.revision = undefined
      this.graphId = id
      if (mapHash !== this.mapHash) this.turnTo(mapHash)
      await this.readAndTell()
    })
  }

  /** Leaves the world. The history is kept: a restarted server has the same map. */
  forget(): void {
    void this.enqueue(async () => {
      this.graphId = undefined
      this.revision = undefined
      batch(() => {
        this.list.value = []
        this.unapplied.value = []
        this.failure.value = ''
      })
    })
  }

  /** Puts aside what was done and held on one map, and takes out what was on another. */
  private turnTo(mapHash: string): void {
    const { ofMaps } = this
    if (this.mapHash !== undefined) {
      ofMaps.set(this.mapHash, { history: this.history.peek(), conflict: this.conflict.peek() })
    }
    const known = ofMaps.get(mapHash)
    ofMaps.delete(mapHash)
    for (const oldest of [...ofMaps.keys()].slice(0, -MAX_MAPS)) ofMaps.delete(oldest)
    this.mapHash = mapHash
    batch(() => {
      this.history.value = known?.history ?? NOTHING_DONE
      this.conflict.value = known?.conflict
    })
  }

  /** Adds edits to the active layer; several are done and undone as one. */
  apply(...edits: Edit[]): Promise<void> {
    const layer = this.active.peek()
    return this.enqueue(async () => {
      const conflict = this.conflict.peek()
      if (conflict !== undefined) {
        this.conflict.value = { ...conflict, held: [...conflict.held, { layer, edits }] }
        this.context.toasts.say('Resolve the conflict first: the edit waits until then.')
        return
      }
      await this.append({ layer, edits })
    })
  }

  /** Applies the edits of a conflict to the layers as they are now. */
  applyOnTop(): Promise<void> {
    return this.enqueue(async () => {
      const { held } = this.conflict.peek() ?? { held: [] }
      const mayBeTaken = held.some(({ sentOver }) => sentOver !== undefined)
      if (held.length === 0) return this.discardConflict()
      try {
        if (this.graphId === undefined) throw new NoGraph()
        if (mayBeTaken || this.revision === undefined) await this.read()
      } catch (error) {
        this.conflict.value = { why: whyHeld(error), held, changes: this.conflict.peek()?.changes ?? [] }
        return
      }
      await this.appendAll(held)
    })
  }

  private async appendAll(held: readonly Held[]): Promise<void> {
    for (const [index, step] of held.entries()) {
      this.conflict.value = undefined
      const now = editsOf(this.list.peek(), step.layer)
      if (step.sentOver !== undefined && wasTaken(step.edits, step.sentOver, now)) this.noteAppended(step)
      else await this.append(step)
      const again = this.conflict.peek() as Conflict | undefined
      if (again === undefined) continue
      // It is held again, and those behind it with it.
      this.conflict.value = { ...again, held: [...again.held, ...held.slice(index + 1)] }
      return
    }
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
      const { layers, unapplied, revision } = await this.context.planner.calls.getLayers({ graphId }, TIMED)
      this.revision = revision
      this.readFailures = 0
      batch(() => {
        this.list.value = layers
        this.unapplied.value = unapplied
        this.failure.value = ''
      })
    } catch (error) {
      this.failure.value = inWords(error)
      this.readFailures += 1
      void this.readLater(failureOf(error))
      throw error
    }
  }

  /** Reads, and says what others did to a graph that was known. */
  private async readAndTell(): Promise<void> {
    const wasKnown = this.revision !== undefined
    const before = this.list.peek()
    await this.read()
    if (!wasKnown) return
    for (const change of differenceOf(before, this.list.peek())) this.context.toasts.say(changeInWords(change))
  }

  /** Reads after a pause what could not be read, of the graph that is shown by then. */
  private async readLater(failure: Failure): Promise<void> {
    const { planner, signal } = this.context
    if (this.isReadDue || !MAY_BE_READ_LATER.has(failure)) return
    this.isReadDue = true
    await (failure === 'token' ? planner.session.nextToken(signal) : sleep(pauseAfter(this.readFailures), signal))
    this.isReadDue = false
    if (signal.aborted) return
    await this.enqueue(async () => {
      if (this.failure.peek() === '') return
      // It has been said once, and comes here again.
      await this.readAndTell().catch(() => undefined)
    })
  }

  /** Reads what is certainly out of date; a failure is tried again later. */
  private async readAgain(): Promise<void> {
    await this.read().catch(() => undefined)
    this.onChange()
  }

  /** Sends edits. Those that were not taken, though nothing is wrong with them, are held. */
  private async append(step: Held): Promise<void> {
    const before = editsOf(this.list.peek(), step.layer)
    try {
      await this.sendAppend(step.layer, step.edits)
    } catch (error) {
      const failure = failureOf(error)
      if (failure === 'refused' || failure === 'unsupported') {
        return report(this.context, `Not applied: ${step.edits.map(describe).join(', ')}`, error)
      }
      if (failure === 'role') reportEdit(this.context, 'Not applied', error)
      const isLost = (failure === 'gone' || failure === 'cancelled') && !(error instanceof NoGraph)
      return this.hold({ ...step, sentOver: isLost ? before : step.sentOver }, error)
    }
    this.noteAppended(step)
  }

  private noteAppended({ layer, edits }: Held): void {
    this.history.value = withStep(this.history.peek(), { kind: 'append', layer, edits })
    const end = editsOf(this.list.peek(), layer).length
    const reason = edits.map((_, at) => this.unappliedReason(layer, end - 1 - at)).find((it) => it !== undefined)
    if (reason !== undefined) this.context.toasts.say(`The edit is kept, but changes nothing: ${reason}.`, 'bad')
  }

  private async hold(step: Held, error: unknown): Promise<void> {
    const before = this.list.peek()
    // Held at once: whatever fails from here on, it is not lost.
    this.conflict.value = { why: whyHeld(error), held: [step], changes: [] }
    if (failureOf(error) !== 'changed') return
    await this.readAgain()
    const conflict = this.conflict.peek()
    if (conflict === undefined) return
    this.conflict.value = { ...conflict, changes: differenceOf(before, this.list.peek()) }
  }

  /** Whether there are layers to change; says so if there are not. */
  private canChange(what: string): boolean {
    if (this.graphId !== undefined && this.revision !== undefined) return true
    this.context.toasts.say(`${what}: ${new NoGraph().message}`, 'bad')
    return false
  }

  private async put(name: string, after: Edit[]): Promise<void> {
    if (!this.canChange(`Layer ${name} was not changed`)) return
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
    if (step === undefined || !this.canChange('Not undone')) return
    try {
      while (canUndo(step, this.list.peek())) {
        if (await this.tookBack(step)) {
          this.history.value = afterUndo(this.history.peek())
          return
        }
        // A layer changed elsewhere. Undoing is still right unless it was this layer.
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
      await (step.kind === 'append'
        ? this.sendUndo(step.layer, step.edits.length)
        : this.sendPut(step.layer, step.before))
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
    if (step === undefined || !this.canChange('Not done again')) return
    if (!canRedo(step, this.list.peek())) {
      return this.context.toasts.say(`Cannot redo: layer ${step.layer} has changed since.`, 'bad')
    }
    try {
      await (step.kind === 'append' ? this.sendAppend(step.layer, step.edits) : this.sendPut(step.layer, step.after))
      this.history.value = afterRedo(this.history.peek())
    } catch (error) {
      await this.explain('Not done again', error)
    }
  }

  private async explain(what: string, error: unknown): Promise<void> {
    if (failureOf(error) !== 'changed') return reportEdit(this.context, what, error)
    await this.readAgain()
    this.context.toasts.say(`${what}: another client changed the layers meanwhile. Check them and try again.`, 'bad')
  }

  private sendAppend(layer: string, edits: Edit[]): Promise<void> {
    return this.send(layer, [...editsOf(this.list.peek(), layer), ...edits], (base) =>
      this.context.planner.calls.appendEdits({ ...base, layer, edits }, TIMED),
    )
  }

  private sendUndo(layer: string, count: number): Promise<void> {
    return this.send(layer, editsOf(this.list.peek(), layer).slice(0, -count), (base) =>
      this.context.planner.calls.undoEdits({ ...base, layer, count }, TIMED),
    )
  }

  private sendPut(name: string, edits: Edit[]): Promise<void> {
    return this.send(name, edits, (base) =>
      this.context.planner.calls.putLayer({ ...base, layer: create(LayerSchema, { name, edits }) }, TIMED),
    )
  }

  /** Sends a change for the revision that is known, and notes what the layer is after it. */
  private async send(
    name: string,
    after: Edit[],
    call: (base: { graphId: string; ifRevision: bigint }) => Promise<Changed>,
  ): Promise<void> {
    if (this.graphId === undefined || this.revision === undefined) throw new NoGraph()
    this.saving.value += 1
    try {
      const { unapplied, revision } = await call({ graphId: this.graphId, ifRevision: this.revision })
      this.revision = revision
      batch(() => {
        this.list.value = withLayer(this.list.peek(), name, after)
        this.unapplied.value = unapplied
      })
      this.onChange()
    } finally {
      this.saving.value -= 1
    }
  }
}

/** Why edits are held, for people. */
function whyHeld(error: unknown): string {
  if (error instanceof NoGraph) return error.message
  switch (failureOf(error)) {
    case 'changed':
      return 'Another user changed the layers while you were editing.'
    case 'missing':
      return 'The planner has not loaded this graph. Apply the edit again once the graph is shown.'
    default:
      return inWords(error)
  }
}

/** The layers with one of them replaced, by name; one without edits is forgotten. */
export function withLayer(layers: readonly Layer[], name: string, edits: Edit[]): Layer[] {
  const others = layers.filter((layer) => layer.name !== name)
  const all = edits.length > 0 ? [...others, create(LayerSchema, { name, edits })] : others
  return all.sort((a, b) => (a.name < b.name ? -1 : 1))
}
