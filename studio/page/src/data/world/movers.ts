// The movers of a world: doors, lifts, platforms, floors that vanish, conveyors, crates. What they do, and what would be lost without them.

import { create } from '@bufbuild/protobuf'
import { batch, computed, signal } from '@preact/signals'
import { type GetGraphResponse, type MoverStops, MoverStopsSchema } from '../../gen/surefoot/planner/v1/planner_pb'
import { type Mover, MoverKind, type MoverState } from '../../gen/surefoot/world/v1/living_pb'
import type { Place } from '../../view/viewport.types'
import { type Context, report } from '../context'
import { link, reachable } from '../graph/islands'

export const MOVER_KINDS: Record<MoverKind, string> = {
  [MoverKind.UNSPECIFIED]: 'Mover',
  [MoverKind.DOOR]: 'Door',
  [MoverKind.LIFT]: 'Lift',
  [MoverKind.PLATFORM]: 'Platform',
  [MoverKind.FLOOR]: 'Floor',
  [MoverKind.CONVEYOR]: 'Conveyor',
  [MoverKind.CRATE]: 'Crate',
}

/** What each mover does, by its index on the map. */
export type StatesByMover = ReadonlyMap<number, MoverState>

/** What a client may tell a mover. */
export type Order = { case: 'stop'; value: number } | { case: 'open'; value: boolean } | { case: 'cycle'; value: true }

/** What is known after states have come: all of them, or those that have changed. */
export function afterStates(known: StatesByMover, states: readonly MoverState[], isDelta: boolean): StatesByMover {
  if (isDelta && states.length === 0) return known
  const next = new Map(isDelta ? known : [])
  for (const state of states) next.set(state.mover, state)
  return next
}

/** What a mover does, in words. */
export function doing(kind: MoverKind, state: MoverState | undefined): string {
  if (state === undefined) return ''
  const stops = state.fromStop === state.toStop
  const blocked = state.blocked ? ', held up' : ''
  const halted = state.pace === 0 ? ', halted' : ''
  if (kind === MoverKind.CONVEYOR) return state.pace === 0 ? 'halted' : 'runs'
  if (kind === MoverKind.DOOR) {
    if (stops) return state.fromStop === 0 ? 'shut' : 'open'
    return (state.toStop === 0 ? 'shuts' : 'opens') + blocked + halted
  }
  if (kind === MoverKind.CRATE) {
    if (state.pose?.isThere !== true) return 'fell off the map'
    const { x, y, z } = state.pose.offset ?? { x: 0, y: 0, z: 0 }
    const distance = Math.hypot(x, y, z)
    return (distance < 0.25 ? 'in its place' : `${distance.toFixed(1)} m from its place`) + (halted && ', held')
  }
  if (kind === MoverKind.FLOOR) return state.pose?.isThere === true ? 'there' : 'away'
  return (stops ? `at stop ${state.fromStop + 1}` : `to stop ${state.toStop + 1}`) + blocked + halted
}

/** Whether a door is commanded to be open, or a floor to be in place. */
export function isOpen(kind: MoverKind, state: MoverState | undefined): boolean {
  return kind === MoverKind.DOOR ? state?.toldStop === 1 : state?.toldStop === 0
}

/** What a click on a mover tells it: doors and floors change, lifts and platforms go to their next stop, crates back to their place; undefined: nothing. */
export function onClick(mover: Mover, state: MoverState | undefined): Order | undefined {
  if (mover.kind === MoverKind.CRATE) return { case: 'stop', value: 0 }
  if (mover.stops.length < 2) return undefined
  if (mover.kind === MoverKind.DOOR || mover.kind === MoverKind.FLOOR) {
    return { case: 'open', value: !isOpen(mover.kind, state) }
  }
  return { case: 'stop', value: ((state?.toldStop ?? state?.toStop ?? 0) + 1) % mover.stops.length }
}

/** The stops at which a mover stands sooner or later, as bits; undefined: at all of them. */
export function stopsAhead(mover: Mover, state: MoverState | undefined, locked: boolean): number | undefined {
  if (locked) return 1
  const told = state?.toldStop
  const isCalled = mover.kind === MoverKind.LIFT || mover.kind === MoverKind.PLATFORM
  return told === undefined || isCalled || mover.stops.length < 2 ? undefined : 1 << told
}

/** Vertices that nobody reaches any more from the best connected one while movers stand only at these stops. */
export function lostWithout(graph: GetGraphResponse, stops: readonly MoverStops[]): Place[] {
  const allowed = new Map(stops.map(({ mover, stops }) => [mover, stops]))
  const isMet = (mover: number, needed: number) => ((allowed.get(mover) ?? ~0) & needed) !== 0
  const [all, open] = [new Map<number, Set<number>>(), new Map<number, Set<number>>()]
  for (const { from, to, needs, ride } of graph.edges) {
    link(all, from, to)
    const isOpen = needs.every(({ mover, stops }) => isMet(mover, stops))
    if (isOpen && (ride === undefined || isMet(ride.mover, 1 << ride.toStop))) link(open, from, to)
  }
  const start = largestIsland(graph)
  if (start === undefined) return []
  const kept = reachable(open, start)
  return [...reachable(all, start)]
    .filter((vertex) => !kept.has(vertex))
    .map((vertex) => graph.vertices[vertex])
    .filter((place) => place !== undefined)
}

/** A vertex of the island with the most vertices. */
function largestIsland({ islands }: GetGraphResponse): number | undefined {
  const counts = new Map<number, number>()
  for (const island of islands) counts.set(island, (counts.get(island) ?? 0) + 1)
  const [best] = [...counts].sort((a, b) => b[1] - a[1])
  return best === undefined ? undefined : islands.indexOf(best[0])
}

export class Movers {
  readonly list = signal<readonly Mover[]>([])
  readonly states = signal<StatesByMover>(new Map())
  /** Indices of the movers that the user locks to see the plan without them. */
  readonly locked = signal<ReadonlySet<number>>(new Set())
  /** Mover states that plans take as given: doors at their commanded stops, and locked movers. */
  readonly given = computed<readonly MoverStops[]>(() =>
    this.list.value.flatMap((mover, index) => {
      const stops = stopsAhead(mover, this.states.value.get(index), this.locked.value.has(index))
      return stops === undefined ? [] : [create(MoverStopsSchema, { mover: index, stops })]
    }),
  )

  /** A key that changes when plans have to be made again. */
  readonly givenKey = computed(() => this.given.value.map(({ mover, stops }) => `${mover}:${stops}`).join(' '))

  constructor(private readonly context: Context) {}

  /** Asks for the movers of a world. */
  async load(worldId: bigint, signal: AbortSignal): Promise<void> {
    try {
      const { movers, states } = await this.context.world.calls.listMovers({ worldId }, { signal })
      batch(() => {
        this.list.value = movers
        this.take(states, false)
      })
    } catch (error) {
      if (!signal.aborted) report(this.context, 'Movers cannot be listed', error)
    }
  }

  take(states: readonly MoverState[], isDelta: boolean): void {
    this.states.value = afterStates(this.states.peek(), states, isDelta)
  }

  async order(worldId: bigint, name: string, where: Order): Promise<void> {
    try {
      const { state } = await this.context.world.calls.setMover({ worldId, name, where })
      if (state !== undefined) this.take([state], true)
    } catch (error) {
      report(this.context, `${name} does not move`, error)
    }
  }

  toggleLock(index: number): void {
    const locked = new Set(this.locked.peek())
    if (!locked.delete(index)) locked.add(index)
    this.locked.value = locked
  }

  forget(): void {
    batch(() => {
      this.list.value = []
      this.states.value = new Map()
      this.locked.value = new Set()
    })
  }
}
