// A link that reopens a view: what it holds, and how that is written behind the # of an address.

import type { CameraPose, EdgeColour, GraphPresence, Place } from '../view/viewport.types'

/** Where the camera stands; without a target where it follows an NPC. */
export type LinkedCamera = Omit<CameraPose, 'target'> & { target?: Place | undefined }

export interface ViewLink {
  /** The world, and the first digits of its map's hash: a restarted server has other worlds with equal ids. */
  world: { id: bigint; map: string }
  camera?: LinkedCamera | undefined
  /** The selected NPC. */
  npc?: bigint | undefined
  follows: boolean
  top: boolean
  graph: GraphPresence
  colour: EdgeColour
  trails: boolean
  names: boolean
  /** Everything above is hidden, m. */
  section?: number | undefined
  start?: Place | undefined
  goal?: Place | undefined
}

/** Digits of a map's hash in a link. */
const MAP_DIGITS = 8
const PRESENCES: readonly GraphPresence[] = ['off', 'faint', 'full']
const COLOURS: readonly EdgeColour[] = ['chance', 'seconds', 'ability', 'island', 'traffic']
/** No place of a map is farther from its corner, m. */
const FARTHEST_M = 100_000

export const mapDigits = (mapHash: string): string => mapHash.slice(0, MAP_DIGITS)

/** What stands behind the #. */
export function encodeLink(link: ViewLink): string {
  const { world, camera, npc, follows, top, graph, colour, trails, names, section, start, goal } = link
  const parts = [`world=${world.id}.${world.map}`]
  if (camera !== undefined) {
    parts.push(`camera=${numbers([camera.distance, camera.azimuth, camera.polar])}`)
    if (camera.target !== undefined) parts.push(`at=${written(camera.target)}`)
  }
  if (npc !== undefined) parts.push(`npc=${npc}`)
  if (npc !== undefined && follows) parts.push('follow=1')
  if (top) parts.push('top=1')
  if (graph !== 'faint') parts.push(`graph=${graph}`)
  if (colour !== 'chance') parts.push(`colour=${colour}`)
  if (!trails) parts.push('trails=0')
  if (!names) parts.push('names=0')
  if (section !== undefined) parts.push(`section=${numbers([section])}`)
  if (start !== undefined) parts.push(`start=${written(start)}`)
  if (goal !== undefined) parts.push(`goal=${written(goal)}`)
  return parts.join('&')
}

/** Reads what stands behind the #, with or without it; undefined: it names no view. What cannot be read is left out. */
export function decodeLink(hash: string): ViewLink | undefined {
  const given = new URLSearchParams(hash.replace(/^#/, ''))
  const [, id, map] = /^(\d{1,20})\.([0-9a-f]{1,64})$/.exec(given.get('world') ?? '') ?? []
  if (id === undefined || map === undefined) return undefined
  const npc = /^\d{1,20}$/.exec(given.get('npc') ?? '')?.[0]
  const [section] = read(given.get('section'), 1) ?? []
  return {
    world: { id: BigInt(id), map },
    camera: cameraOf(given),
    npc: npc === undefined ? undefined : BigInt(npc),
    follows: npc !== undefined && given.get('follow') === '1',
    top: given.get('top') === '1',
    graph: PRESENCES.find((it) => it === given.get('graph')) ?? 'faint',
    colour: COLOURS.find((it) => it === given.get('colour')) ?? 'chance',
    trails: given.get('trails') !== '0',
    names: given.get('names') !== '0',
    section,
    start: placeOf(given.get('start')),
    goal: placeOf(given.get('goal')),
  }
}

function cameraOf(given: URLSearchParams): LinkedCamera | undefined {
  const [distance, azimuth, polar] = read(given.get('camera'), 3) ?? []
  if (distance === undefined || azimuth === undefined || polar === undefined) return undefined
  const upright = Math.min(Math.PI / 2, Math.max(0, polar))
  return {
    distance: Math.min(4000, Math.max(2.5, distance)),
    azimuth,
    polar: upright,
    target: placeOf(given.get('at')),
  }
}

const numbers = (values: readonly number[]): string => values.map((value) => Number(value.toFixed(2))).join(',')

const written = ({ x, y, z }: Place): string => numbers([x, y, z])

/** So many numbers, none of them beyond reason. */
function read(text: string | null, count: number): number[] | undefined {
  const values = (text ?? '').split(',').map((part) => (part.trim() === '' ? Number.NaN : Number(part)))
  return values.length === count && values.every((value) => Math.abs(value) <= FARTHEST_M) ? values : undefined
}

function placeOf(text: string | null): Place | undefined {
  const [x, y, z] = read(text, 3) ?? []
  return x === undefined || y === undefined || z === undefined ? undefined : { x, y, z }
}
