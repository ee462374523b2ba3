// Having a graph built, with the map handed on to a planner that does not know it yet.

import { Code, ConnectError } from '@connectrpc/connect'
import { type BuildGraphResponse, type BuildSettings } from '../../gen/surefoot/planner/v1/planner_pb'
import { MapFormat } from '../../gen/surefoot/world/v1/maps_pb'
import type { World } from '../../gen/surefoot/world/v1/world_pb'
import type { Context } from '../context'

/** Builds the graph of a world's map, or has it found in the cache; the last message has the summary. */
export async function* buildGraph(
  context: Context,
  world: World,
  settings: BuildSettings | undefined,
  signal: AbortSignal,
): AsyncGenerator<BuildGraphResponse, void, void> {
  const which = world.map === undefined ? { mapHash: world.mapHash } : { map: world.map }
  const request = settings === undefined ? which : { ...which, settings }
  try {
    yield* context.planner.calls.buildGraph(request, { signal })
  } catch (error) {
    const isUnknownMap = ConnectError.from(error).code === Code.NotFound && world.map === undefined
    if (!isUnknownMap) throw error
    await handMapOn(context, world.mapHash, signal)
    yield* context.planner.calls.buildGraph(request, { signal })
  }
}

async function handMapOn(context: Context, mapHash: string, signal: AbortSignal): Promise<void> {
  const { map, file } = await context.world.maps.getMap({ mapHash }, { signal })
  await context.planner.maps.importMap({ name: map?.name ?? '', format: MapFormat.SAVED, file }, { signal })
}
