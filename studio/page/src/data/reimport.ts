// A level with a changed sidecar: imported again, and shown where it was shown before.

import type { World } from '../gen/surefoot/world/v1/world_pb'
import type { Place } from '../view/viewport.types'
import { linkOf } from './opening'
import type { Studio } from './studio'
import { mapDigits } from './view-link'
import type { Imported } from './world/import'

/**
 * Imports the level again and, if its map is shown, shows the new one from the same side.
 * Returns whether it was imported. `withMarks`: the sidecar lists the marks now.
 */
export async function importAgain(studio: Studio, sidecar: string, withMarks = false): Promise<boolean> {
  const { levels, marks, worlds } = studio
  const [before, world] = [levels.imported.peek(), worlds.chosen.peek()]
  if (before === undefined || levels.isBusy.peek()) return false
  levels.isBusy.value = true
  try {
    const now = await levels.again(sidecar)
    if (now === undefined) return false
    if (withMarks) marks.clear()
    const isShown = world !== undefined && world.mapHash === before.mapHash && worlds.chosenId.peek() === world.worldId
    if (isShown && now.mapHash !== before.mapHash) await showInstead(studio, world, before, now)
    return true
  } finally {
    levels.isBusy.value = false
  }
}

/** Shows a world of the new map. The world before it goes, if this page made it and nothing was put into it. */
async function showInstead(studio: Studio, world: World, before: Imported, now: Imported): Promise<void> {
  const { worlds, marks, live, pieces } = studio
  const move = shift(before.frame?.origin, now.frame?.origin)
  const link = linkOf(studio)
  const kept = marks.list.peek().map(({ kind, at, to }) => ({ kind, at: move(at), to: to && move(to) }))
  const isEmpty = live.npcs.peek().size === 0 && (pieces.laid.peek()?.pieces.length ?? 0) === 0
  const [body] = world.bodies
  const wanted = { mapHash: now.mapHash, solidNpcs: world.solidNpcs }
  const made = await worlds.create(body === undefined ? wanted : { ...wanted, body })
  if (made === undefined) return
  marks.list.value = kept
  if (link !== undefined) {
    const { camera, section } = link
    const target = camera?.target && move(camera.target)
    studio.openLink({
      ...link,
      world: { id: made.worldId, map: mapDigits(made.mapHash) },
      camera: camera && { ...camera, target },
      section: section && move({ x: 0, y: section, z: 0 }).y,
      npc: undefined,
      follows: false,
      start: undefined,
      goal: undefined,
    })
  }
  if (isEmpty && worlds.made.has(world.worldId)) await worlds.drop(world.worldId)
}

/** Moves places of the map with the level's origin. */
function shift(from: Place | undefined, to: Place | undefined): (place: Place) => Place {
  if (from === undefined || to === undefined) return (place) => place
  return ({ x, y, z }) => ({ x: x + to.x - from.x, y: y + to.y - from.y, z: z + to.z - from.z })
}
