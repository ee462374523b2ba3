// Keeps the 3D view in step with what the page knows.

import { computed, effect } from '@preact/signals'
import { marksOf } from '../data/edit/edits'
import { moverNames, npcNames, placeNames, planNames, playerNames, reachNames, topOf } from '../data/names'
import type { Studio } from '../data/studio'
import { PICKABLE } from './tools'
import { featuresWith } from '../data/world/marks'
import { motionAt } from '../data/world/motion'
import { lostWithout } from '../data/world/movers'
import { posesOf } from '../data/world/player'
import { poseOf } from '../data/world/snapshot'
import { type Mover, MoverKind, type MoverState } from '../gen/surefoot/world/v1/living_pb'
import { Outcome } from '../gen/surefoot/world/v1/world_pb'
import { MARK_COLOURS } from '../view/colours'
import type { MoverPose, MoverShape, Place, SelectedNpc, Viewport } from '../view/viewport.types'

const ORIGIN: Place = { x: 0, y: 0, z: 0 }
/** How far above its place a mark of what would be lost is drawn, m. */
const LOST_M = 1.2

/** Shows everything, and goes on doing so until what is returned is called. */
export function show(studio: Studio, viewport: Viewport): () => void {
  const { graphs, layers, live, npcs, player, plans, reach, builds, view, marks, movers, surveys, replays } = studio
  const ends = [
    effect(() => {
      const { tick, npcs } = live.moment.value
      viewport.setNpcs(tick, [...npcs.values()].map(poseOf))
    }),
    effect(() => viewport.setPlayers(posesOf(live.moment.value.players, player.body.value, player.at.value))),
    effect(() => viewport.setMovers(movers.list.value.map(shapeOf))),
    effect(() => {
      void movers.list.value
      viewport.setMoverPoses(new Map([...movers.states.value].map(([index, state]) => [index, poseOfMover(state)])))
    }),
    effect(() => viewport.setTrails(view.trails.value)),
    effect(() => viewport.setLabelsVisible(view.names.value)),
    ...showNames(studio, viewport),
    effect(() => {
      const shown = replays.shown.value
      const seconds = replays.seconds.value
      viewport.setReplay(
        shown && {
          track: shown.track,
          seconds,
          yaw: motionAt(shown.motion, seconds).heading,
          colour: replayColour(shown.outcome),
        },
      )
    }),
    effect(() => viewport.setSelectedNpc(selectedNpc(studio))),
    effect(() => viewport.follow(npcs.camera.value ? npcs.selectedId.value : undefined)),
    effect(() => viewport.setGraph(graphs.shown.value)),
    effect(() => viewport.setGraphFilter(graphs.filter.value)),
    effect(() => viewport.setTraffic(graphs.traffic.value)),
    effect(() => showSelection(studio, viewport)),
    effect(() => viewport.setDraggable(studio.tool.value === 'move')),
    effect(() => viewport.setPickable(PICKABLE[studio.tool.value])),
    effect(() => viewport.setPaths(plans.lines.value)),
    effect(() => {
      viewport.setMarkers(plans.start.value, plans.goal.value, plans.nearest.value)
    }),
    effect(() => viewport.setReachArea(reach.area.value)),
    effect(() => {
      viewport.setEditMarks(
        marksOf(layers.list.value, (layer, index) => layers.unappliedReason(layer, index) !== undefined),
      )
    }),
    effect(() => {
      const result = builds.comparison.value?.result
      const shown = surveys.list.value.find(({ body }) => body === surveys.shown.value)?.survey
      const graph = movers.locked.value.size > 0 ? graphs.loaded.value : undefined
      // Above the vertices, which would hide them.
      const lost = graph && lostWithout(graph, movers.given.value).map((at) => ({ ...at, y: at.y + LOST_M }))
      const gained = shown === undefined && lost === undefined ? (result?.gained ?? []) : []
      viewport.setDifference(lost ?? shown?.cutOff ?? result?.lost ?? [], gained)
    }),
    effect(() => {
      const { value: features } = studio.level.features
      if (features !== undefined) viewport.setFeatures(featuresWith(features, marks.list.value))
    }),
    effect(() => {
      // Again for each map: with the one before it, the view forgets what was outlined.
      void studio.level.features.value
      viewport.setOutline(studio.selectedBox.value)
    }),
    effect(() => viewport.setSection(view.section.value ? view.sectionHeight.value : undefined)),
    effect(() => viewport.setTopView(view.top.value)),
    effect(() => viewport.setTheme({ dark: view.dark.value })),
  ]
  return () => {
    for (const end of ends) end()
  }
}

/** Names of places, of what moves, and of what is selected. */
function showNames(studio: Studio, viewport: Viewport): (() => void)[] {
  const { level, pieces, marks, movers, npcs, plans, player, reach } = studio
  const tops = computed(() => movers.list.value.map(topOf))
  return [
    effect(() => {
      const features = level.features.value
      const named = features && placeNames(featuresWith(features, marks.list.value), pieces.laid.value?.pieces ?? [])
      viewport.setLabels('places', named ?? [])
    }),
    effect(() => viewport.setLabels('movers', moverNames(movers.list.value, tops.value, movers.states.value))),
    effect(() => {
      const followed = npcs.followed.value
      viewport.setLabels('npc', followed?.id === npcs.selectedId.value && followed ? npcNames(followed) : [])
    }),
    effect(() => viewport.setLabels('player', playerNames(player.at.value))),
    effect(() => viewport.setLabels('reach', reachNames(reach.start.value))),
    effect(() => {
      viewport.setLabels('plan', planNames(plans.start.value, plans.goal.value, plans.nearest.value))
    }),
  ]
}

function replayColour(outcome: Outcome | undefined): string {
  if (outcome === undefined) return MARK_COLOURS.nearest
  return outcome === Outcome.REACHED ? MARK_COLOURS.gained : MARK_COLOURS.lost
}

function shapeOf({ positions, pivot, kind }: Mover): MoverShape {
  // A copy: the numbers need not begin at a multiple of four bytes.
  return {
    positions: new Float32Array(positions.slice().buffer),
    pivot: pivot ?? ORIGIN,
    isDoor: kind === MoverKind.DOOR,
  }
}

function poseOfMover({ pose }: MoverState): MoverPose {
  return { offset: pose?.offset ?? ORIGIN, yaw: pose?.yaw ?? 0, isThere: pose?.isThere ?? true }
}

function selectedNpc({ npcs }: Studio): SelectedNpc | undefined {
  const followed = npcs.followed.value
  if (followed === undefined || followed.id !== npcs.selectedId.value) return undefined
  return {
    id: followed.id,
    waypoints: followed.plan?.waypoints ?? [],
    abilities: (followed.plan?.legs ?? []).map(({ ability }) => ability),
    heading: followed.waypointIdx,
    eyes: followed.eyes,
    rays: followed.rays.map(({ end, surface }) => ({ end: end ?? { x: 0, y: 0, z: 0 }, surface })),
  }
}

function showSelection(studio: Studio, viewport: Viewport): void {
  const selection = studio.graphs.selection.value
  const half = studio.forceFrom.value
  viewport.selectVertex(half ?? (selection?.kind === 'vertex' ? selection.index : undefined))
  viewport.selectEdge(selection?.kind === 'edge' ? { from: selection.from, to: selection.to } : undefined)
}
