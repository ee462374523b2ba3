// The map of the world that is shown: loaded tile by tile, and in more detail where the camera is.

import { signal } from '@preact/signals'
import type { Box, Features, MeshTile, Place } from '../../view/viewport.types'
import { type Context, report } from '../context'
import { inWords } from '../net/errors'
import { keepAsking, keepDoing } from '../net/stream'
import {
  boxOf,
  firstCell,
  missingTiles,
  overlap,
  readFeatures,
  readTile,
  type TileRange,
  tilesOf,
  tilesWithin,
} from './tiles'

/** A mesh that cannot be made would not be made the next time either. */
const PATIENCE = { breakdowns: 3 }

/** Where a map goes to. */
export interface LevelSink {
  clear(): void
  setFeatures(features: Features): void
  putTile(tile: MeshTile, fine: boolean): void
  dropTile(key: string): void
  fineTiles(): ReadonlySet<string>
}

export type LevelState =
  | { kind: 'none' }
  | { kind: 'loading'; done: number; total: number }
  | { kind: 'ready'; tiles: number; seconds: number }
  | { kind: 'failed'; why: string }

interface Wish {
  around: Place
  radius: number
}

interface Running {
  wish: Wish
  range: TileRange
  stop: AbortController
}

export class Level {
  readonly state = signal<LevelState>({ kind: 'none' })
  readonly features = signal<Features | undefined>(undefined)
  private loaded: { worldId: bigint; sink: LevelSink; signal: AbortSignal } | undefined
  private running: Running | undefined
  private wanted: Wish | undefined
  /** Tiles asked for since the last wish: empty ones never come, and others may have had to give way already. */
  private readonly asked = new Set<string>()

  constructor(private readonly context: Context) {}

  /** Loads the map of a world until the signal aborts. */
  async load(worldId: bigint, sink: LevelSink, signal: AbortSignal): Promise<void> {
    const { world } = this.context
    const upkeep = { link: world.link, session: world.session, signal }
    const began = performance.now()
    this.forget()
    sink.clear()
    this.state.value = { kind: 'loading', done: 0, total: 0 }
    try {
      const answer = await keepAsking(upkeep, (signal) => world.calls.getFeatures({ worldId }, { signal }))
      if (answer === undefined) return
      const features = readFeatures(answer)
      this.features.value = features
      sink.setFeatures(features)
      const cellM = firstCell(features.size)
      const tiles = await this.loadWhole(worldId, cellM, sink, signal)
      if (tiles === undefined || signal.aborted) return
      this.state.value = { kind: 'ready', tiles, seconds: (performance.now() - began) / 1000 }
      if (cellM > 0) this.loaded = { worldId, sink, signal }
      if (this.wanted !== undefined) this.refine()
    } catch (error) {
      if (!signal.aborted) this.state.value = { kind: 'failed', why: inWords(error) }
    }
  }

  /** Reloads the tiles inside a box, because the map was edited there. */
  async redraw(worldId: bigint, sink: LevelSink, box: Box, signal: AbortSignal): Promise<void> {
    const { calls } = this.context.world
    try {
      const features = readFeatures(await calls.getFeatures({ worldId }, { signal }))
      if (signal.aborted || this.features.peek() === undefined) return
      this.features.value = features
      const range = tilesWithin(box, features.size)
      const empty = new Set(tilesOf(range))
      for await (const message of calls.getMesh(
        { worldId, region: boxOf(range, features.size), cellM: 0 },
        { signal },
      )) {
        if (signal.aborted) return
        const tile = readTile(message)
        empty.delete(`${tile.tileX},${tile.tileZ}`)
        sink.putTile(tile, true)
      }
      // Where nothing is left, nothing comes.
      for (const key of empty) sink.dropTile(key)
    } catch (error) {
      if (!signal.aborted) report(this.context, 'The edited map cannot be shown', error)
    }
  }

  forget(): void {
    this.running?.stop.abort()
    this.loaded = undefined
    this.running = undefined
    this.wanted = undefined
    this.asked.clear()
    this.features.value = undefined
    this.state.value = { kind: 'none' }
  }

  /** The camera is here: full detail is wanted around it. One region is loaded at a time. */
  want(around: Place, radius: number): void {
    this.wanted = { around, radius }
    this.asked.clear()
    this.refine()
  }

  private async loadWhole(worldId: bigint, cellM: number, sink: LevelSink, signal: AbortSignal) {
    const { world } = this.context
    const stop = new AbortController()
    let tiles: number | undefined
    const upkeep = { link: world.link, session: world.session, signal: AbortSignal.any([signal, stop.signal]) }
    const error = await keepDoing(
      upkeep,
      async (gotSomething) => {
        let done = 0
        for await (const message of world.calls.getMesh({ worldId, cellM }, { signal })) {
          if (signal.aborted) return
          gotSomething()
          sink.putTile(readTile(message), cellM === 0)
          done += 1
          this.state.value = { kind: 'loading', done, total: message.tileCount }
        }
        tiles = done
        stop.abort()
      },
      PATIENCE,
    )
    if (error !== undefined) throw error
    return tiles
  }

  private refine(): void {
    const { loaded, wanted } = this
    const size = this.features.peek()?.size
    if (loaded === undefined || wanted === undefined || size === undefined || loaded.signal.aborted) return
    const fine = loaded.sink.fineTiles()
    const range = missingTiles(wanted.around, wanted.radius, size, (tile) => fine.has(tile) || this.asked.has(tile))
    if (range === undefined) return
    if (this.running !== undefined) {
      if (!overlap(this.running.range, range)) this.running.stop.abort()
      return
    }
    const running = { wish: wanted, range, stop: new AbortController() }
    this.running = running
    for (const tile of tilesOf(range)) this.asked.add(tile)
    void this.loadFine(loaded, running).finally(() => {
      if (this.running !== running) return
      this.running = undefined
      if (this.wanted !== running.wish) this.refine()
    })
  }

  private async loadFine(
    { worldId, sink, signal }: { worldId: bigint; sink: LevelSink; signal: AbortSignal },
    { wish, range, stop }: Running,
  ): Promise<void> {
    const size = this.features.peek()?.size
    if (size === undefined) return
    const both = AbortSignal.any([signal, stop.signal])
    try {
      const request = { worldId, region: boxOf(range, size), cellM: 0 }
      for await (const message of this.context.world.calls.getMesh(request, { signal: both })) {
        if (both.aborted) return
        sink.putTile(readTile(message), true)
      }
    } catch {
      // The coarse map stays. What is wanted next tries again, once the camera moves.
      if (!both.aborted && this.wanted === wish) this.wanted = undefined
    }
  }
}
