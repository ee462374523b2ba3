// What a page shows first: the view of its link, or an NPC under way from near by.

import { batch, effect, untracked } from '@preact/signals'
import type { Studio } from './studio'
import { npcToOpenOn } from './world/under-way'
import { mapDigits, type ViewLink } from './view-link'

/** Opens each world that is shown. */
export function keepOpening(studio: Studio): void {
  const { level, live, npcs, opening, link, tool, viewport } = studio
  effect(() => {
    if (!opening.value || viewport.value === undefined || level.features.value === undefined) return
    const wanted = link.value
    if (wanted !== undefined) return untracked(() => openLink(studio, wanted))
    if (npcs.selectedId.value !== undefined || tool.value !== 'select') {
      // The user was quicker.
      opening.value = false
      return
    }
    const npc = npcToOpenOn(live.moment.value.npcs)
    if (npc === undefined) return
    batch(() => {
      opening.value = false
      studio.tab.value = 'npcs'
      npcs.goAlong(npc.npcId)
    })
  })
}

/** Shows the view of a link on the world that is shown. */
function openLink(studio: Studio, wanted: ViewLink): void {
  const { worlds, link, opening, context } = studio
  const world = worlds.chosen.peek()
  if (world === undefined) return
  link.value = undefined
  if (!world.mapHash.startsWith(wanted.world.map)) {
    context.toasts.say(`The link is for world ${wanted.world.id}, which does not exist any more.`)
    return
  }
  opening.value = false
  restore(studio, wanted)
}

function restore({ view, graphs, plans, npcs, live, viewport }: Studio, wanted: ViewLink): void {
  batch(() => {
    view.top.value = wanted.top
    view.trails.value = wanted.trails
    view.names.value = wanted.names
    view.section.value = wanted.section !== undefined
    if (wanted.section !== undefined) view.sectionHeight.value = wanted.section
    graphs.setFilter({ presence: wanted.graph, colour: wanted.colour })
    npcs.select(wanted.npc)
    npcs.camera.value = wanted.follows
  })
  plans.setEnds(wanted.start, wanted.goal)
  const { camera } = wanted
  const shown = viewport.peek()
  if (camera === undefined || shown === undefined) return
  const npc = wanted.npc === undefined ? undefined : live.moment.peek().npcs.get(wanted.npc)
  const target = camera.target ?? npc?.position ?? shown.camera().target
  shown.setCamera({ ...camera, target })
}

/**
 * The link of the present view; undefined: nothing is shown yet. Effects that call it run again when the view changes,
 * but not for the camera and the height of the section, which change in every frame while they are moved.
 */
export function linkOf(studio: Studio): ViewLink | undefined {
  const { worlds, view, graphs, plans, npcs, viewport } = studio
  const [world, shown] = [worlds.chosen.value, viewport.value]
  if (world === undefined || shown === undefined) return undefined
  const follows = npcs.camera.value
  const { target, ...angles } = shown.camera()
  const { presence, colour } = graphs.filter.value
  return {
    world: { id: world.worldId, map: mapDigits(world.mapHash) },
    camera: follows ? angles : { ...angles, target },
    npc: npcs.selectedId.value,
    follows,
    top: view.top.value,
    graph: presence,
    colour,
    trails: view.trails.value,
    names: view.names.value,
    section: view.section.value ? view.sectionHeight.peek() : undefined,
    start: plans.start.value,
    goal: plans.goal.value,
  }
}
