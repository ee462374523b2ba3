// Names of what is on a map, as labels: devices with their kind, movers and pieces by name, ends and legs of plans.

import { type Mover, MoverKind, type MoverState } from '../gen/surefoot/world/v1/living_pb'
import { Ability } from '../gen/surefoot/world/v1/map_pb'
import type { Piece } from '../gen/surefoot/world/v1/piece_pb'
import { Surface } from '../gen/surefoot/world/v1/world_pb'
import { lookOf } from '../view/abilities'
import { MARK_COLOURS, STATE_COLOURS, SURFACE_COLOURS } from '../view/colours'
import { arc, pointAlong } from '../view/edge-shape'
import type { Features, Label, Place } from '../view/viewport.types'
import { abilityName } from './abilities'
import { MOVER_KINDS } from './world/movers'
import type { Followed } from './world/npcs'
import { boxOf } from './world/pieces'
import { npcNumber, stateOf } from './world/snapshot'

/** Over the ground, m: above what they name. */
const DEVICE_M = 3
const ZIP_LINE_M = 4
const POOL_M = 0.5
const NPC_M = 2.1
const END_M = 2.6
/** Legs ahead of an NPC that are named. */
const LEGS = 5

/** Ranks: what was chosen and what comes next, then legs that need an ability, what people have named, and the rest. */
const [CHOSEN, NEXT, ABLE, NAMED, USUAL] = [0, 1, 2, 3, 4]

const ORIGIN: Place = { x: 0, y: 0, z: 0 }

const raised = (place: Place, by: number): Place => ({ x: place.x, y: place.y + by, z: place.z })

/** Devices and pools by their kind, pieces by their names. */
export function placeNames(features: Features, pieces: readonly Piece[]): Label[] {
  const named = (text: string, at: Place, lift: number, surface: Surface): Label => ({
    text,
    at: raised(at, lift),
    rank: USUAL,
    colour: SURFACE_COLOURS[surface],
  })
  return [
    ...features.pads.map(({ centre }) => named('Jump pad', centre, DEVICE_M, Surface.PAD)),
    ...features.zipLines.map(({ from }) => named('Zip line', from, ZIP_LINE_M, Surface.ZIP_LINE)),
    ...features.teleporters.flatMap(({ from, to, twoWay }) => [
      named('Teleporter', from, DEVICE_M, Surface.TELEPORTER),
      named(twoWay ? 'Teleporter' : 'Teleporter exit', to, DEVICE_M, Surface.TELEPORTER),
    ]),
    ...features.jetpacks.map((at) => named('Jetpack', at, DEVICE_M, Surface.JETPACK)),
    ...features.spots.map(({ tag, from }) => ({
      text: tag,
      at: raised(from, DEVICE_M),
      rank: USUAL,
      colour: lookOf(Ability.OWN_1).colour,
    })),
    ...features.pools.map(({ centre, lava }) =>
      lava ? named('Lava', centre, POOL_M, Surface.LAVA) : named('Water', centre, POOL_M, Surface.WATER),
    ),
    ...pieces.flatMap((piece) => {
      const box = boxOf(piece)
      if (box === undefined) return []
      const at = { x: (box.low.x + box.high.x) / 2, y: box.high.y, z: (box.low.z + box.high.z) / 2 }
      return [{ text: piece.name, at, rank: NAMED }]
    }),
  ]
}

/** The middle of a mover's top as it was modelled. */
export function topOf({ positions }: Mover): Place {
  const corners = new Float32Array(positions.slice().buffer)
  const low = [Infinity, Infinity, Infinity]
  const high = [-Infinity, -Infinity, -Infinity]
  corners.forEach((value, at) => {
    low[at % 3] = Math.min(low[at % 3]!, value)
    high[at % 3] = Math.max(high[at % 3]!, value)
  })
  return { x: (low[0]! + high[0]!) / 2, y: high[1]!, z: (low[2]! + high[2]!) / 2 }
}

/** Movers by name, where they are now. `tops`: as `topOf` has them. */
export function moverNames(
  movers: readonly Mover[],
  tops: readonly Place[],
  states: ReadonlyMap<number, MoverState>,
): Label[] {
  return movers.flatMap(({ name, kind, pivot = ORIGIN }, index) => {
    const [top, pose] = [tops[index], states.get(index)?.pose]
    if (top === undefined || pose?.isThere === false) return []
    const [sin, cos] = [Math.sin(pose?.yaw ?? 0), Math.cos(pose?.yaw ?? 0)]
    const [dx, dz] = [top.x - pivot.x, top.z - pivot.z]
    const { x, y, z } = pose?.offset ?? ORIGIN
    const at = { x: pivot.x + cos * dx + sin * dz + x, y: top.y + y + 0.3, z: pivot.z - sin * dx + cos * dz + z }
    return [{ text: moverName(name, kind), at, rank: NAMED }]
  })
}

/** A name with its kind, unless it says that itself. */
function moverName(name: string, kind: MoverKind): string {
  const word = MOVER_KINDS[kind]
  return name.toLowerCase().includes(word.toLowerCase()) ? name : `${name} (${word.toLowerCase()})`
}

/** The selected NPC, its goal, and the legs ahead of it. */
export function npcNames({ id, npc, plan, waypointIdx }: Followed): Label[] {
  if (npc === undefined) return []
  const colour = STATE_COLOURS[stateOf(npc)]
  const labels: Label[] = [{ text: `NPC ${npcNumber(id)}`, at: ORIGIN, npc: { id, lift: NPC_M }, rank: NEXT, colour }]
  const waypoints = plan?.waypoints ?? []
  const goal = npc.goal ?? waypoints.at(-1)
  if (goal !== undefined)
    labels.push({ text: 'Goal', at: raised(goal, END_M), rank: CHOSEN, colour: MARK_COLOURS.goal })
  plan?.legs.slice(waypointIdx, waypointIdx + LEGS).forEach(({ ability }, ahead) => {
    const index = waypointIdx + ahead
    const [from, to] = [waypoints[index - 1], waypoints[index]]
    if (to === undefined) return
    // The leg that it is on is named at its end: the NPC itself is where it begins.
    const at = ahead === 0 || from === undefined ? to : pointAlong(arc(from, to, ability, 'smooth'), 0.5).at
    const rank = ahead === 0 ? CHOSEN : ability === Ability.WALK ? USUAL : ABLE
    labels.push({ text: abilityName(ability), at: raised(at, 0.6), rank, colour: lookOf(ability).colour })
  })
  return labels
}

/** The player of this page. */
export function playerNames(at: Place | undefined): Label[] {
  return at === undefined ? [] : [{ text: 'Player', at: raised(at, NPC_M), rank: CHOSEN, colour: MARK_COLOURS.player }]
}

/** Where the area of the area tool starts. */
export function reachNames(start: Place | undefined): Label[] {
  return start === undefined ? [] : [{ text: 'Start', at: raised(start, 1), rank: CHOSEN, colour: MARK_COLOURS.start }]
}

/** The ends of a plan that was asked for. */
export function planNames(start: Place | undefined, goal: Place | undefined, nearest: Place | undefined): Label[] {
  const end = (text: string, at: Place | undefined, colour: string): Label[] =>
    at === undefined ? [] : [{ text, at: raised(at, END_M), rank: CHOSEN, colour }]
  return [
    ...end('Start', start, MARK_COLOURS.start),
    ...end('Goal of the plan', goal, MARK_COLOURS.goal),
    ...end('Nearest reachable place', nearest, MARK_COLOURS.nearest),
  ]
}
