// A world as it goes: its NPCs and how it is doing.

import { batch, signal } from '@preact/signals'
import type { MoverState, Player } from '../../gen/surefoot/world/v1/living_pb'
import type { Npc, WatchStatsResponse, WatchWorldResponse, WorldStats } from '../../gen/surefoot/world/v1/world_pb'
import { type Context, report } from '../context'
import { sleep } from '../net/backoff'
import { failureOf } from '../net/errors'
import { keepReading } from '../net/stream'
import { afterSnapshot, type NpcsById, type StatsSample } from './snapshot'

const RATE_HZ = 20
/** A stream that is silent for so long is taken for dead. */
const IDLE_MS = 10_000
/** Panels are updated less often than the view. */
const PANEL_MS = 300
/** Pause before the next request for a missing world. */
const MISSING_MS = 1000
/** How often figures come, and how many of them are kept. */
const STATS_MS = 800
const SAMPLES = 30

export interface Moment {
  tick: bigint
  npcs: NpcsById
  players: readonly Player[]
}

const NOBODY: Moment = { tick: 0n, npcs: new Map(), players: [] }

export class Live {
  /** The latest moment, for the view. */
  readonly moment = signal<Moment>(NOBODY)
  /** The same a few times a second, for panels. */
  readonly npcs = signal<NpcsById>(NOBODY.npcs)
  readonly stats = signal<WorldStats | undefined>(undefined)
  readonly samples = signal<readonly StatsSample[]>([])
  private told = 0

  constructor(
    private readonly context: Context,
    /** Called with each pose that comes. */
    private readonly takePose: (tick: number, npc: Npc) => void,
    private readonly takeMovers: (states: readonly MoverState[], isDelta: boolean) => void,
    /** Called with the revision of the map, again and again. */
    private readonly takeRevision: (revision: bigint) => void,
  ) {}

  npc(id: bigint | undefined): Npc | undefined {
    return id === undefined ? undefined : this.npcs.value.get(id)
  }

  /** Watches a world and its figures until the signal aborts. */
  async watch(worldId: bigint, signal: AbortSignal): Promise<void> {
    const { world } = this.context
    const request = { worldId, rateHz: RATE_HZ, delta: true }
    const watchNpcs = (signal: AbortSignal) => world.calls.watchWorld(request, { signal })
    const watchStats = (signal: AbortSignal) =>
      oneByOne((signal) => world.calls.watchStats({ worldId, periodS: 60 }, { signal }), STATS_MS, signal)
    await Promise.all([
      this.keepWatching(watchNpcs, (message) => this.take(message), signal),
      this.keepWatching(watchStats, (message) => this.keep(message), signal),
    ])
  }

  private async keepWatching<T>(
    open: (signal: AbortSignal) => AsyncIterable<T>,
    take: (message: T) => void,
    signal: AbortSignal,
  ): Promise<void> {
    const { world } = this.context
    while (!signal.aborted) {
      const error = await keepReading({ link: world.link, session: world.session, signal }, open, take, IDLE_MS)
      if (error === undefined) return
      if (failureOf(error) !== 'missing') return report(this.context, 'The world cannot be watched', error)
      // A restarted server may be about to restore the world. The poll removes a world that is gone for good.
      await sleep(MISSING_MS, signal)
    }
  }

  forget(): void {
    batch(() => {
      this.moment.value = NOBODY
      this.npcs.value = NOBODY.npcs
      this.stats.value = undefined
      this.samples.value = []
    })
  }

  private take(message: WatchWorldResponse): void {
    const npcs = afterSnapshot(this.moment.peek().npcs, message)
    const now = performance.now()
    const tick = Number(message.tick)
    for (const npc of message.npcs) this.takePose(tick, npc)
    for (const { npcId } of message.changed) {
      const npc = npcs.get(npcId)
      if (npc !== undefined) this.takePose(tick, npc)
    }
    batch(() => {
      this.moment.value = { tick: message.tick, npcs, players: message.players }
      this.takeMovers(message.movers, message.isDelta)
      this.takeRevision(message.mapRevision)
      if (now - this.told < PANEL_MS) return
      this.told = now
      this.npcs.value = npcs
    })
  }

  private keep({ stats }: WatchStatsResponse): void {
    if (stats === undefined) return
    const samples = this.samples.peek()
    const last = samples.at(-1)
    // A restarted server counts from zero.
    const isAnew = last !== undefined && stats.decisionsRequested < last.stats.decisionsRequested
    batch(() => {
      this.stats.value = stats
      this.samples.value = [...(isAnew ? [] : samples), { atMs: performance.now(), stats }].slice(-SAMPLES)
    })
  }
}

/**
 * The first message of a stream, again and again. Browsers open six connections to a server without TLS: two windows with
 * three streams each could make no other call.
 */
async function* oneByOne<T>(
  open: (signal: AbortSignal) => AsyncIterable<T>,
  pauseMs: number,
  signal: AbortSignal,
): AsyncGenerator<T> {
  while (!signal.aborted) {
    const enough = new AbortController()
    for await (const message of open(AbortSignal.any([signal, enough.signal]))) {
      yield message
      break
    }
    enough.abort()
    await sleep(pauseMs, signal)
  }
}
