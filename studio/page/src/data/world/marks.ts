// Lava, water and devices that a designer marks on an imported level, and their entries in its sidecar.

import { batch, signal } from '@preact/signals'
import { UpAxis } from '../../gen/surefoot/world/v1/maps_pb'
import type { Features, Place } from '../../view/viewport.types'
import { readSidecar, type Sidecar, writeSidecar } from './sidecar'

export type MarkKind = 'lava' | 'water' | 'pad' | 'zipLine' | 'teleporter' | 'jetpack' | 'anchor' | 'spawn'

/** Kinds that take two clicks: two corners of a pool, or the two ends of a way. */
const PAIRED: ReadonlySet<MarkKind> = new Set(['lava', 'water', 'zipLine', 'teleporter'])

/** How high the surface of a pool lies above the higher of its corners, and its ground below the lower one, m. */
const POOL_ABOVE_M = 0.3
const POOL_BELOW_M = 1
/** How high a pad throws, m, unless the file says otherwise; and what pads are drawn with. */
const PAD_HEIGHT_M = 4
const PAD_SPEED = 20

/** A feature on the map, m. */
export interface Mark {
  kind: MarkKind
  at: Place
  /** The other corner or end, where the kind has one. */
  to?: Place | undefined
}

/** How a level's coordinates become those of its map. */
export interface Frame {
  /** Where the level's origin lies on the map, m. */
  origin: Place
  /** Metres per unit of the level. */
  scale: number
  up: UpAxis
}

export class Marks {
  readonly kind = signal<MarkKind>('lava')
  readonly list = signal<readonly Mark[]>([])
  /** The first of two clicks. */
  readonly begun = signal<Place | undefined>(undefined)

  choose(kind: MarkKind): void {
    batch(() => {
      this.kind.value = kind
      this.begun.value = undefined
    })
  }

  /** A click on the map. */
  click(at: Place): void {
    const kind = this.kind.peek()
    const first = this.begun.peek()
    batch(() => {
      if (PAIRED.has(kind) && first === undefined) {
        this.begun.value = at
        return
      }
      this.begun.value = undefined
      this.list.value = [...this.list.value, first === undefined ? { kind, at } : { kind, at: first, to: at }]
    })
  }

  remove(index: number): void {
    this.list.value = this.list.value.filter((_, other) => other !== index)
  }

  clear(): void {
    batch(() => {
      this.list.value = []
      this.begun.value = undefined
    })
  }
}

/** A place of the map in the level's own coordinates. */
export function toLevel({ x, y, z }: Place, { origin, scale, up }: Frame): [number, number, number] {
  const [east, above, south] = [(x - origin.x) / scale, (y - origin.y) / scale, (z - origin.z) / scale]
  return up === UpAxis.Z ? [east, -south, above] : [east, above, south]
}

/** A place of the level, in its own coordinates, on the map. */
export function toMap([a, b, c]: readonly [number, number, number], { origin, scale, up }: Frame): Place {
  const [above, south] = up === UpAxis.Z ? [c, -b] : [b, c]
  return { x: a * scale + origin.x, y: above * scale + origin.y, z: south * scale + origin.z }
}

/** Opposite corners of the box of liquid between two places. */
function poolBox(a: Place, b: Place): { low: Place; high: Place } {
  return {
    low: { x: Math.min(a.x, b.x), y: Math.min(a.y, b.y) - POOL_BELOW_M, z: Math.min(a.z, b.z) },
    high: { x: Math.max(a.x, b.x), y: Math.max(a.y, b.y) + POOL_ABOVE_M, z: Math.max(a.z, b.z) },
  }
}

/** The content of a sidecar with these marks after its own entries. @throws SyntaxError if it is not JSON. */
export function sidecarWith(before: string, marks: readonly Mark[], frame: Frame): string {
  const sidecar = readSidecar(before)
  for (const { kind, at, to = at } of marks) {
    const { low, high } = poolBox(at, to)
    const pool = { liquid: kind, min: toLevel(low, frame), max: toLevel(high, frame) }
    const way = { from: toLevel(at, frame), to: toLevel(to, frame) }
    const entries: Record<MarkKind, readonly [list: Exclude<keyof Sidecar, 'nodes' | 'names'>, entry: object]> = {
      lava: ['pools', pool],
      water: ['pools', pool],
      pad: ['pads', { at: way.from, height: PAD_HEIGHT_M }],
      zipLine: ['zip_lines', way],
      teleporter: ['teleporters', way],
      jetpack: ['jetpacks', { at: way.from }],
      anchor: ['anchors', { at: way.from }],
      spawn: ['spawns', { at: way.from }],
    }
    const [list, entry] = entries[kind]
    sidecar[list] = [...(sidecar[list] ?? []), entry]
  }
  return writeSidecar(sidecar)
}

/** The features of a map with marks drawn as if they were there already. */
export function featuresWith(features: Features, marks: readonly Mark[]): Features {
  const of = (...kinds: MarkKind[]) => marks.filter(({ kind }) => kinds.includes(kind))
  const pools = of('lava', 'water').map(({ kind, at, to }) => {
    const { low, high } = poolBox(at, to ?? at)
    const [halfX, halfZ] = [(high.x - low.x) / 2, (high.z - low.z) / 2]
    const centre = { x: low.x + halfX, y: high.y, z: low.z + halfZ }
    return { centre, halfX, halfZ, round: false, depth: high.y - low.y, lava: kind === 'lava' }
  })
  const ways = (kind: MarkKind) => of(kind).map(({ at, to }) => ({ from: at, to: to ?? at }))
  return {
    size: features.size,
    pools: [...features.pools, ...pools],
    pads: [...features.pads, ...of('pad').map(({ at }) => ({ centre: at, speed: PAD_SPEED }))],
    zipLines: [...features.zipLines, ...ways('zipLine')],
    teleporters: [...features.teleporters, ...ways('teleporter').map((way) => ({ ...way, twoWay: false }))],
    jetpacks: [...features.jetpacks, ...of('jetpack').map(({ at }) => at)],
    spots: [
      ...features.spots,
      ...of('anchor', 'spawn').map(({ kind, at }) => ({ tag: kind, from: at, to: undefined, twoWay: false })),
    ],
  }
}
