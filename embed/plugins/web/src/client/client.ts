// The services as pages use them: generated Connect clients, and helpers for what takes more than one call.

import { type Client, createClient, type Interceptor, type Transport } from '@connectrpc/connect'
import { createConnectTransport } from '@connectrpc/connect-web'
import { checkVec3, SurefootError } from '../checks.ts'
import { type Build, BuildStage, PlannerService } from '../gen/surefoot/planner/v1/planner_pb.ts'
import { EnvService } from '../gen/surefoot/world/v1/env_pb.ts'
import { MapFormat, MapService, UpAxis } from '../gen/surefoot/world/v1/maps_pb.ts'
import {
  type EventCursor,
  type NpcEvent,
  type WatchWorldResponse,
  WorldService,
} from '../gen/surefoot/world/v1/world_pb.ts'
import { type Vec3, ZERO } from '../vec3.ts'
import { ServicePlanner } from './planner.ts'
import { keepWatching, type WatchOptions } from './watch.ts'

export interface Addresses {
  /** URL of a world server, such as http://127.0.0.1:7600. */
  world?: string
  /** URL of a planner, such as http://127.0.0.1:7601. */
  planner?: string
  /** The token that calls are made with, where services want one. */
  token?: string
}

export interface ImportOptions {
  /** Content of the level's .surefoot.json, which lists features. */
  sidecar?: string
  /** Metres per unit of the level; absent: 1. */
  scale?: number
  /** Vertical axis of the level; absent: y. */
  up?: 'y' | 'z'
}

export interface ImportedLevel {
  mapHash: string
  /** Where the level's origin lies on its map, m: a place of the level plus this is one of the map. */
  origin: Vec3
  /** Problems that a designer may want to correct, for people. */
  warnings: string[]
}

/** An NPC to add. */
export interface NewNpc {
  /** Place of the feet on the map, m. */
  position: Vec3
  /** Heading, rad; 0 faces +z. */
  yaw?: number
  /** Where it goes, m; absent: it stands still. */
  goal?: Vec3
}

const FORMATS: Record<string, MapFormat> = {
  sfmap: MapFormat.SAVED,
  glb: MapFormat.GLTF,
  gltf: MapFormat.GLTF,
  obj: MapFormat.OBJ,
}
/** Largest part of a level in one request: below what services accept in a message. */
const CHUNK_BYTES = 512 * 1024

/**
 * Connects to services; nothing is sent before the first call.
 * @throws SurefootError if an address is none.
 */
export function connect(addresses: Addresses): Surefoot {
  return new Surefoot(addresses)
}

export class Surefoot {
  private readonly world: Transport | undefined
  private readonly plans: Transport | undefined

  constructor({ world, planner, token }: Addresses) {
    if (world === undefined && planner === undefined) {
      throw new SurefootError('connect needs the address of a world server (world) or a planner (planner)')
    }
    this.world = world === undefined ? undefined : transportTo('world', world, token)
    this.plans = planner === undefined ? undefined : transportTo('planner', planner, token)
  }

  /** All calls of the world service. */
  get worlds(): Client<typeof WorldService> {
    return createClient(WorldService, this.needWorld())
  }

  /** All calls of the environment service, but for its stream, which browsers cannot open. */
  get envs(): Client<typeof EnvService> {
    return createClient(EnvService, this.needWorld())
  }

  /** All calls of the planner service. */
  get planner(): Client<typeof PlannerService> {
    return createClient(PlannerService, this.needPlanner())
  }

  /** Imports a level's file (.glb, .gltf, .obj or .sfmap) on every service that is connected, since each keeps its own maps. */
  async importLevel(name: string, file: Uint8Array, options: ImportOptions = {}): Promise<ImportedLevel> {
    const format = FORMATS[name.split('.').pop()?.toLowerCase() ?? '']
    if (format === undefined) {
      throw new SurefootError(`${name} is no level that can be imported: name a .glb, .gltf, .obj or .sfmap file`)
    }
    const transports = [this.world, this.plans].filter((transport) => transport !== undefined)
    const imported = await Promise.all(
      transports.map((transport) => importOn(createClient(MapService, transport), { name, format, file, options })),
    )
    return imported[0]!
  }

  /** Starts a world on a map that was imported. Returns its id. */
  async createWorld(mapHash: string): Promise<bigint> {
    const { world } = await this.worlds.createWorld({ mapHash, requestId: crypto.randomUUID() })
    return found(world, 'world').worldId
  }

  /**
   * Adds NPCs to a world, at most 4096. Returns their ids in order.
   * @throws SurefootError if the server did not add one of them; it says which and why.
   */
  async spawn(worldId: bigint, npcs: NewNpc[]): Promise<bigint[]> {
    npcs.forEach(({ position, goal }, idx) => {
      checkVec3(`npcs[${idx}].position`, position)
      if (goal !== undefined) checkVec3(`npcs[${idx}].goal`, goal)
    })
    const requestId = crypto.randomUUID()
    const { results } = await this.worlds.batchSpawnNpcs({ worldId, spawns: npcs, requestId })
    return results.map(({ result }, idx) => {
      if (result.case === 'npcId') return result.value
      throw new SurefootError(`npcs[${idx}] was not added: ${result.value?.message ?? 'the server gave no reason'}`)
    })
  }

  /**
   * Yields snapshots of a world, `rateHz` a second, and connects again when the connection breaks. With `movement`, they
   * have what animations need.
   */
  watchWorld(
    worldId: bigint,
    { rateHz = 10, movement = false, ...options }: WatchOptions & { rateHz?: number; movement?: boolean } = {},
  ): AsyncGenerator<WatchWorldResponse, void> {
    return keepWatching((signal) => this.worlds.watchWorld({ worldId, rateHz, movement }, { signal }), options)
  }

  /**
   * Yields everything that happens to the NPCs of a world from now on, each event once. When the connection breaks, it goes on after the
   * last event that came.
   * @throws ConnectError if the server no longer keeps the events that were missed.
   */
  async *watchEvents(worldId: bigint, options: WatchOptions = {}): AsyncGenerator<NpcEvent, void> {
    let after: EventCursor | undefined
    const open = (signal: AbortSignal) => {
      return this.worlds.watchEvents({ worldId, ...(after !== undefined && { after }) }, { signal })
    }
    for await (const { cursor, events } of keepWatching(open, options)) {
      yield* events
      after = cursor ?? after
    }
  }

  /**
   * Builds the graph of a map that was imported, or finds it in the cache; takes seconds to minutes. Returns the graph's id.
   * @throws SurefootError if the build fails or is cancelled.
   */
  async buildGraph(
    mapHash: string,
    {
      vertices = 0,
      onProgress,
      ...options
    }: WatchOptions & { vertices?: number; onProgress?: (build: Build) => void } = {},
  ): Promise<string> {
    const started = await this.planner.startBuild({ mapHash, settings: { vertices } })
    const { buildId } = found(started.build, 'build')
    for await (const message of keepWatching((signal) => this.planner.watchBuild({ buildId }, { signal }), options)) {
      const build = found(message.build, 'build')
      onProgress?.(build)
      if (build.stage === BuildStage.DONE) return build.graphId
      if (build.stage < BuildStage.FAILED) continue
      throw new SurefootError(`the graph was not built: ${build.failure?.message ?? 'the build was cancelled'}`)
    }
    throw new SurefootError('the build of the graph was not waited for: the signal aborted')
  }

  /** Plans on a graph of the planner; `origin` is the origin of the imported level; leave it out if places are in map coordinates. */
  plannerOf(graphId: string, origin: Vec3 = ZERO): ServicePlanner {
    return new ServicePlanner(this.planner, graphId, origin)
  }

  private needWorld(): Transport {
    if (this.world !== undefined) return this.world
    throw new SurefootError('no world server is connected: give connect its address as world')
  }

  private needPlanner(): Transport {
    if (this.plans !== undefined) return this.plans
    throw new SurefootError('no planner is connected: give connect its address as planner')
  }
}

interface Level {
  name: string
  format: MapFormat
  file: Uint8Array
  options: ImportOptions
}

async function importOn(
  maps: Client<typeof MapService>,
  { name, format, file, options }: Level,
): Promise<ImportedLevel> {
  const { sidecar = '', scale = 1, up = 'y' } = options
  const uploadId = crypto.randomUUID()
  for (let at = 0; at < file.length; at += CHUNK_BYTES) {
    await maps.uploadChunk({ uploadId, offset: BigInt(at), data: file.subarray(at, at + CHUNK_BYTES) })
  }
  const upAxis = up === 'z' ? UpAxis.Z : UpAxis.Y
  const imported = await maps.importMap({ name, format, uploadId, sidecar, scale, up: upAxis })
  const { x, y, z } = imported.origin ?? ZERO
  return { mapHash: found(imported.map, 'map').mapHash, origin: { x, y, z }, warnings: imported.warnings }
}

function transportTo(name: string, address: string, token: string | undefined): Transport {
  if (!URL.canParse(address)) {
    throw new SurefootError(`${name} is ${address}, but must be a complete address such as http://127.0.0.1:7600`)
  }
  const authorize: Interceptor = (next) => (request) => {
    if (token !== undefined) request.header.set('authorization', `Bearer ${token}`)
    return next(request)
  }
  return createConnectTransport({ baseUrl: address, interceptors: [authorize], useBinaryFormat: true })
}

function found<T>(value: T | undefined, what: string): T {
  if (value !== undefined) return value
  throw new SurefootError(`the service answered without a ${what}: is it another version?`)
}
