// The worlds of the server, and which of them is shown.

import type { MessageInitShape } from '@bufbuild/protobuf'
import { batch, computed, signal } from '@preact/signals'
import { MapKind, type MapSpec } from '../../gen/surefoot/world/v1/map_pb'
import type { Piece } from '../../gen/surefoot/world/v1/piece_pb'
import { type CreateWorldRequestSchema, TimeMode, type World } from '../../gen/surefoot/world/v1/world_pb'
import { type Context, report } from '../context'
import { shortId } from '../format'
import { sleep } from '../net/backoff'
import { failureOf, mayPass } from '../net/errors'
import { keepAsking } from '../net/stream'

const POLL_MS = 3000
const TIMEOUT_MS = 5000

export type WorldsState = 'loading' | 'ready' | 'failed'

export class Worlds {
  readonly list = signal<readonly World[]>([])
  readonly state = signal<WorldsState>('loading')
  readonly chosenId = signal<bigint | undefined>(undefined)
  readonly creating = signal(false)
  /** Worlds that this page has made. */
  readonly made = new Set<bigint>()
  /** Names of imported levels by their hash; empty for those that the server does not list. */
  private readonly names = signal<ReadonlyMap<string, string>>(new Map())
  /** The world to show first, of which a link names the id and the first digits of its map's hash. */
  wanted: { id: bigint; map: string } | undefined
  readonly chosen = computed(() => this.list.value.find(({ worldId }) => worldId === this.chosenId.value))
  /** Distinguishes worlds even if a restarted server reuses ids; undefined: no world is chosen. */
  readonly key = computed(() => {
    const world = this.chosen.value
    return world === undefined ? undefined : `${world.worldId} ${world.mapHash}`
  })

  constructor(private readonly context: Context) {}

  /** Keeps the list up to date until the page goes. */
  async poll(): Promise<void> {
    const { signal, world } = this.context
    while (!signal.aborted) {
      try {
        const answer = await keepAsking({ link: world.link, session: world.session, signal }, (signal) =>
          world.calls.listWorlds({ pageSize: 1000 }, { signal, timeoutMs: TIMEOUT_MS }),
        )
        if (answer !== undefined) this.take(answer.worlds)
        await this.learnNames()
      } catch (error) {
        this.state.value = 'failed'
        report(this.context, 'Worlds cannot be listed', error)
      }
      await sleep(POLL_MS, signal)
    }
  }

  choose(id: bigint): void {
    this.chosenId.value = id
  }

  /** What a world's map is called. */
  nameOf(world: World): string {
    return mapName(world, this.names.value.get(world.mapHash))
  }

  async create(what: MessageInitShape<typeof CreateWorldRequestSchema>): Promise<World | undefined> {
    this.creating.value = true
    try {
      const { world } = await this.context.world.calls.createWorld({ ...what, mode: TimeMode.REALTIME })
      if (world === undefined) return undefined
      this.made.add(world.worldId)
      batch(() => {
        this.list.value = [...this.list.value, world]
        this.choose(world.worldId)
      })
      void this.learnNames()
      return world
    } catch (error) {
      report(this.context, 'The world was not created', error)
      return undefined
    } finally {
      this.creating.value = false
    }
  }

  async drop(id: bigint): Promise<void> {
    try {
      await this.context.world.calls.dropWorld({ worldId: id })
      // Not taken for one that has ended by itself.
      if (this.chosenId.peek() === id) this.chosenId.value = undefined
      this.take(this.list.value.filter(({ worldId }) => worldId !== id))
    } catch (error) {
      report(this.context, `World ${id} was not dropped`, error)
    }
  }

  private take(worlds: readonly World[]): void {
    const chosen = this.chosenId.value
    const isGone = chosen !== undefined && !worlds.some(({ worldId }) => worldId === chosen)
    batch(() => {
      this.list.value = worlds
      this.state.value = 'ready'
      if (chosen === undefined || isGone) this.chosenId.value = (this.findWanted(worlds) ?? worlds[0])?.worldId
    })
    if (isGone) this.context.toasts.say(`World ${chosen} has ended.`)
  }

  /** Asks what the imported levels are called, where that is not known yet. */
  private async learnNames(): Promise<void> {
    const { signal, world } = this.context
    const hashes = this.list.peek().flatMap(({ map, mapHash }) => (map === undefined ? [mapHash] : []))
    const names = new Map(this.names.peek())
    const unknown = hashes.filter((hash) => !names.has(hash))
    if (unknown.length === 0) return
    for (const hash of unknown) names.set(hash, '')
    try {
      let pageToken = ''
      do {
        const page = await world.maps.listMaps({ pageSize: 1000, pageToken }, { signal, timeoutMs: TIMEOUT_MS })
        for (const { mapHash, name } of page.maps) names.set(mapHash, name)
        pageToken = page.nextPageToken
      } while (pageToken !== '')
    } catch (error) {
      // Without a name, a level is called by its hash.
      if (mayPass(failureOf(error))) return
    }
    this.names.value = names
  }

  /** The world of the link, or another one on the same map. */
  private findWanted(worlds: readonly World[]): World | undefined {
    const { wanted } = this
    if (wanted === undefined) return undefined
    const onMap = worlds.filter(({ mapHash }) => mapHash.startsWith(wanted.map))
    return onMap.find(({ worldId }) => worldId === wanted.id) ?? onMap[0]
  }
}

/** What names the map of a world to services. */
export function mapOf({ map, mapHash }: Pick<World, 'map' | 'mapHash'>): { map: MapSpec } | { mapHash: string } {
  return map === undefined ? { mapHash } : { map }
}

/** A world and what lies on its map. */
export interface Site {
  world: World
  pieces: readonly Piece[]
  /** Hash of the map with its pieces. */
  mapHash: string
}

/** What a world's map is called: "seed 42, 250 x 250 m", with its kind where it is not terrain, or the level's name. */
export function mapName(world: Pick<World, 'map' | 'mapHash'>, level = ''): string {
  if (world.map === undefined) return level || `imported level ${shortId(world.mapHash)}`
  const { seed, size, kind } = world.map
  const isTerrain = kind === MapKind.UNSPECIFIED || kind === MapKind.TERRAIN
  const ground = isTerrain ? '' : `${MapKind[kind].toLowerCase()}, `
  return `${ground}seed ${seed}, ${size?.width ?? 250} x ${size?.depth ?? 250} m`
}
