// Colours of everything that carries a meaning, for the view and for its legends. No renderer here.

import { Ability } from '../gen/surefoot/world/v1/map_pb'
import { Surface } from '../gen/surefoot/world/v1/world_pb'
import { abilityKind, LOOKS, lookOf } from './abilities'
import type { NpcState } from './viewport.types'

/** Red, green and blue as the screen takes them, 0 to 1. */
export type Rgb = readonly [number, number, number]

const ability = (of: Ability): string => lookOf(of).colour

/** By what a ray hit. */
export const SURFACE_COLOURS: Readonly<Record<Surface, string>> = {
  [Surface.UNSPECIFIED]: '#8793a3',
  [Surface.GROUND]: '#e8d9b5',
  [Surface.WATER]: '#3f8cff',
  [Surface.LAVA]: '#ff6a1f',
  [Surface.PAD]: ability(Ability.PAD),
  [Surface.ZIP_LINE]: ability(Ability.ZIP_LINE),
  [Surface.TELEPORTER]: ability(Ability.TELEPORTER),
  [Surface.JETPACK]: ability(Ability.JETPACK),
  [Surface.BODY]: '#f6f8fb',
  [Surface.CLIMB]: ability(Ability.CLIMB),
}

/** By what an NPC is doing. */
export const STATE_COLOURS: Readonly<Record<NpcState, string>> = {
  idle: '#c3ccd8',
  seeking: '#2f8dff',
  down: '#f0384b',
}

export const MARK_COLOURS = {
  start: '#38d977',
  goal: '#ff4d6d',
  player: '#ed59bf',
  nearest: '#ffc93a',
  forbidden: '#ff3b4e',
  lost: '#ff4252',
  gained: '#3ddc84',
  selected: '#ffffff',
  outline: '#ffd60a',
  alternative: '#aab4c2',
} as const

const CHANCE_STOPS = ['#e5383b', '#ee7b30', '#f3c13a', '#9ad148', '#2fb860']
const SECONDS_STOPS = ['#fde725', '#7ad151', '#22a884', '#2a788e', '#414487', '#5b2a86']
const TRAFFIC_STOPS = ['#8a8f98', '#fde725', '#f8961e', '#f3722c', '#e5383b']
const ISLAND_STOPS = [
  '#4cc9f0',
  '#f9c74f',
  '#f94144',
  '#90be6d',
  '#b388eb',
  '#f8961e',
  '#43aa8b',
  '#ff70a6',
  '#8ecae6',
  '#d4a373',
  '#c0f56a',
  '#7c83fd',
]

export function parseColour(colour: string): Rgb {
  const value = Number.parseInt(colour.slice(1), 16)
  return [((value >> 16) & 255) / 255, ((value >> 8) & 255) / 255, (value & 255) / 255]
}

export function mixColours(a: Rgb, b: Rgb, share: number): Rgb {
  return [a[0] + (b[0] - a[0]) * share, a[1] + (b[1] - a[1]) * share, a[2] + (b[2] - a[2]) * share]
}

export function formatColour(colour: Rgb): string {
  return (
    '#' +
    colour
      .map((part) =>
        Math.round(part * 255)
          .toString(16)
          .padStart(2, '0'),
      )
      .join('')
  )
}

function ramp(stops: readonly string[]): (share: number) => Rgb {
  const colours = stops.map(parseColour)
  return (share) => {
    const at = Math.min(1, Math.max(0, Number.isFinite(share) ? share : 0)) * (colours.length - 1)
    const low = Math.min(Math.floor(at), colours.length - 2)
    return mixColours(colours[low]!, colours[low + 1]!, at - low)
  }
}

/** Red for never, green for always. */
export const chanceColour = ramp(CHANCE_STOPS)

/** Bright for the quickest, dark for the slowest; 0 to 1. */
export const secondsColour = ramp(SECONDS_STOPS)

/** NPCs on an edge from which on it has the colour of the busiest. */
export const BUSY_NPCS = 8

/** Grey without NPCs, then from yellow to red; 0 to 1. */
export const trafficColour = ramp(TRAFFIC_STOPS)

const islands = ISLAND_STOPS.map(parseColour)

/** Neighbouring numbers get colours that differ; numbers beyond the palette are spread over it. */
export function islandColour(island: number): Rgb {
  if (island < islands.length && island >= 0) {
    return islands[island]!
  }
  return islands[(Math.imul(island, 0x9e3779b1) >>> 8) % islands.length]!
}

const UNKNOWN_ABILITY = parseColour('#9aa4b2')
const abilityRgb = new Map(LOOKS.map(({ ability, colour }) => [ability, parseColour(colour)]))

export function abilityColour(ability: Ability): Rgb {
  return abilityRgb.get(abilityKind(ability)) ?? UNKNOWN_ABILITY
}
