// Builds of graphs as operations of the planner, with the map handed on to a planner that does not know it yet.

import { Code, ConnectError } from '@connectrpc/connect'
import { type Build, type BuildSettings, BuildStage } from '../../gen/surefoot/planner/v1/planner_pb'
import { MapFormat } from '../../gen/surefoot/world/v1/maps_pb'
import type { World } from '../../gen/surefoot/world/v1/world_pb'
import type { Context } from '../context'

/** Starts building the graph of a world's map, or joins the build that is running, and watches it to its end. */
export async function* buildGraph(
  context: Context,
  world: World,
  settings: BuildSettings | undefined,
  signal: AbortSignal,
): AsyncGenerator<Build, void, void> {
  const started = await startBuild(context, world, settings, signal)
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
  world: World,
  settings: BuildSettings | undefined,
  signal: AbortSignal,
): Promise<Build | undefined> {
  const map = world.map === undefined ? { mapHash: world.mapHash } : { map: world.map }
  const request = settings === undefined ? map : { ...map, settings }
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
  const { map, file } = await context.world.maps.getMap({ mapHash }, { signal })
  await context.planner.maps.importMap({ name: map?.name ?? '', format: MapFormat.SAVED, file }, { signal })
}
