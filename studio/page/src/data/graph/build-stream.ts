// Builds of graphs as operations of the planner, with the map handed on to a planner that does not know it yet.

import { Code, ConnectError } from '@connectrpc/connect'
import { type Build, type BuildSettings, BuildStage } from '../../gen/surefoot/planner/v1/planner_pb'
import { MapFormat } from '../../gen/surefoot/world/v1/maps_pb'
import type { Context } from '../context'
import { CHUNK_BYTES } from '../world/import'
import { mapOf, type Site } from '../world/worlds'

/** Starts building the graph of a world's map, with what lies on it, for the usual body of its NPCs, or joins the build that is running, and watches it to its end. */
export async function* buildGraph(
  context: Context,
  site: Site,
  settings: BuildSettings | undefined,
  signal: AbortSignal,
): AsyncGenerator<Build, void, void> {
  const started = await startBuild(context, site, settings, signal)
  if (started === undefined) return
  for await (const { build } of context.planner.calls.watchBuild({ buildId: started.buildId }, { signal })) {
    if (build === undefined) continue
    if (build.stage === BuildStage.CANCELLED) throw new ConnectError('the build was cancelled', Code.Canceled)
    if (build.failure !== undefined) throw new ConnectError(build.failure.message, build.failure.code)
    yield build
  }
}

async function startBuild(
  context: Context,
  { world, pieces }: Site,
  settings: BuildSettings | undefined,
  signal: AbortSignal,
): Promise<Build | undefined> {
  const [body] = world.bodies
  const map = { ...mapOf(world), pieces: [...pieces] }
  const request = { ...map, ...(settings === undefined ? {} : { settings }), ...(body === undefined ? {} : { body }) }
  try {
    return (await context.planner.calls.startBuild(request, { signal })).build
  } catch (error) {
    const isUnknownMap = ConnectError.from(error).code === Code.NotFound && world.map === undefined
    if (!isUnknownMap) throw error
    await handMapOn(context, world.mapHash, signal)
    return (await context.planner.calls.startBuild(request, { signal })).build
  }
}

async function handMapOn(context: Context, mapHash: string, signal: AbortSignal): Promise<void> {
  let name = ''
  let offset = 0n
  const uploadId = `studio-${mapHash.slice(0, 32)}`
  for await (const { map, chunk } of context.world.maps.getMap({ mapHash }, { signal })) {
    name = map?.name ?? name
    for (let begin = 0; begin < chunk.length; begin += CHUNK_BYTES) {
      const data = chunk.subarray(begin, begin + CHUNK_BYTES)
      await context.planner.maps.uploadChunk({ uploadId, offset, data }, { signal })
      offset += BigInt(data.length)
    }
  }
  await context.planner.maps.importMap({ name, format: MapFormat.SAVED, uploadId }, { signal })
}
