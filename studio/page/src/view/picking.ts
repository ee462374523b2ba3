// What a pointer meets, by distance on the screen. No renderer here.

import type { GroundHit } from './ground'
import type { Hit, Place } from './viewport.types'

/** Reach of a pointer, pixels. */
export const MOUSE_REACH = 10
export const TOUCH_REACH = 18
/** What lies farther behind the ground than this is hidden by it, m. */
const HIDDEN_M = 2

/** Takes places to pixels from the upper left corner. */
export class Projector {
  /** `matrix`: from the world to clip space, column by column. */
  constructor(
    private readonly matrix: ArrayLike<number>,
    private readonly width: number,
    private readonly height: number,
  ) {}

  /** Pixels and depth (m along the line of sight); undefined behind the camera. */
  project(x: number, y: number, z: number): { x: number; y: number; depth: number } | undefined {
    const m = this.matrix
    const w = m[3]! * x + m[7]! * y + m[11]! * z + m[15]!
    if (w <= 1e-6) {
      return undefined
    }
    return {
      x: ((m[0]! * x + m[4]! * y + m[8]! * z + m[12]!) / w + 1) * 0.5 * this.width,
      y: (1 - (m[1]! * x + m[5]! * y + m[9]! * z + m[13]!) / w) * 0.5 * this.height,
      depth: w,
    }
  }
}

export interface Pointer {
  x: number
  y: number
  reach: number
}

export interface Candidate {
  hit: Hit
  /** Pixels from the pointer. */
  pixels: number
  /** Metres along the line of sight. */
  depth: number
}

/** A point that can be picked. */
export interface PickPoint {
  place: Place
  /** Its radius on the ground, m: what looks large is easier to hit. */
  radius: number
  hit: Hit
}

/** The candidate of the point that is nearest to the pointer within its reach. */
export function pickPoint(
  points: Iterable<PickPoint>,
  pointer: Pointer,
  projector: Projector,
  scale: number,
): Candidate[] {
  const met: Candidate[] = []
  for (const { place, radius, hit } of points) {
    const at = projector.project(place.x, place.y, place.z)
    if (!at) {
      continue
    }
    const pixels = Math.hypot(at.x - pointer.x, at.y - pointer.y)
    if (pixels <= Math.max(pointer.reach, (radius * scale) / at.depth)) {
      met.push({ hit, pixels, depth: at.depth })
    }
  }
  return met
}

export interface PickLine {
  points: ArrayLike<number>
  hit: (at: Place) => Hit
}

/** Polylines as pixels, kept while the camera stands still. */
export class ProjectedLines {
  private readonly pixels: Float32Array[]

  constructor(
    private readonly lines: readonly PickLine[],
    projector: Projector,
    ceiling: number,
  ) {
    this.pixels = lines.map(({ points }) => {
      const projected = new Float32Array(points.length)
      for (let at = 0; at < points.length; at += 3) {
        const pixel =
          points[at + 1]! <= ceiling ? projector.project(points[at]!, points[at + 1]!, points[at + 2]!) : undefined
        projected.set(pixel ? [pixel.x, pixel.y, pixel.depth] : [0, 0, -1], at)
      }
      return projected
    })
  }

  /** Those within reach of the pointer. */
  pick(pointer: Pointer): Candidate[] {
    return this.pixels.flatMap((projected, line) => {
      const met = nearestOfLine(projected, pointer)
      return met ? [this.candidate(this.lines[line]!, projected, met)] : []
    })
  }

  private candidate({ points, hit }: PickLine, projected: Float32Array, met: NearLine): Candidate {
    const mix = (values: ArrayLike<number>, offset: number): number =>
      values[met.at + offset]! + (values[met.at + 3 + offset]! - values[met.at + offset]!) * met.share
    return {
      hit: hit({ x: mix(points, 0), y: mix(points, 1), z: mix(points, 2) }),
      pixels: met.pixels,
      depth: mix(projected, 2),
    }
  }
}

interface NearLine {
  at: number
  share: number
  pixels: number
}

function nearestOfLine(projected: Float32Array, pointer: Pointer): NearLine | undefined {
  let best: NearLine | undefined
  for (let at = 0; at + 3 < projected.length; at += 3) {
    if (projected[at + 2]! < 0 || projected[at + 5]! < 0) {
      continue
    }
    const x = projected[at]!
    const y = projected[at + 1]!
    const dx = projected[at + 3]! - x
    const dy = projected[at + 4]! - y
    const square = dx * dx + dy * dy
    const share = square > 0 ? Math.min(1, Math.max(0, ((pointer.x - x) * dx + (pointer.y - y) * dy) / square)) : 0
    const pixels = Math.hypot(x + dx * share - pointer.x, y + dy * share - pointer.y)
    if (pixels <= pointer.reach && pixels < (best?.pixels ?? Infinity)) {
      best = { at, share, pixels }
    }
  }
  return best
}

const ORDER: readonly Hit['kind'][] = ['npc', 'vertex', 'mover', 'edge']

/** NPC before vertex before mover before edge before ground, of one kind the nearest to the pointer, none that the ground hides. */
export function chooseHit(
  candidates: readonly Candidate[],
  ground: GroundHit | undefined,
  groundDepth: number,
  kinds?: ReadonlySet<Hit['kind']>,
): Hit | undefined {
  const wanted = kinds ? candidates.filter(({ hit }) => kinds.has(hit.kind)) : candidates
  const seen = wanted.filter(({ depth }) => !ground || depth <= groundDepth + HIDDEN_M)
  for (const kind of ORDER) {
    const [best] = seen.filter(({ hit }) => hit.kind === kind).sort((a, b) => a.pixels - b.pixels || a.depth - b.depth)
    if (best) {
      return best.hit
    }
  }
  const isWanted = kinds === undefined || kinds.has('ground')
  return ground && isWanted ? { kind: 'ground', at: ground.at, surface: ground.surface } : undefined
}
