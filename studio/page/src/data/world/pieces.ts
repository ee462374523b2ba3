// Pieces on the map of a world: blocks, bridges and pools that a designer puts there while NPCs are on it.

import { create, equals } from '@bufbuild/protobuf'
import { batch, signal } from '@preact/signals'
import { type Piece, PieceSchema } from '../../gen/surefoot/world/v1/piece_pb'
import type { Box, Place } from '../../view/viewport.types'
import { type Context, report } from '../context'
import { failureOf } from '../net/errors'

export type PieceKind = 'block' | 'bridge' | 'lava' | 'water'

/** Kinds that take two clicks: the ends of a bridge, or two corners of a pool. */
const PAIRED: ReadonlySet<PieceKind> = new Set(['bridge', 'lava', 'water'])
/** How high the top of a bridge lies above where one clicked, and the surface of a pool above the higher of its corners, m. */
const BRIDGE_ABOVE_M = 0.05
const POOL_ABOVE_M = 0.3
const POOL_DEPTH_M = 2
/** Least side of a pool, m. */
const LEAST_M = 0.5

/** What a piece is made like, m. */
export interface Sizes {
  /** Sides of a block, and width of a bridge. */
  width: number
  /** Height of a block. */
  height: number
}

/** The piece between one or two places on the ground. */
export function pieceBetween(kind: PieceKind, name: string, from: Place, to: Place, sizes: Sizes): Piece {
  const { width, height } = sizes
  switch (kind) {
    case 'block': {
      const value = { foot: from, width, depth: width, height, yaw: 0 }
      return create(PieceSchema, { name, shape: { case: 'block', value } })
    }
    case 'bridge': {
      const above = (place: Place) => ({ ...place, y: place.y + BRIDGE_ABOVE_M })
      const value = { from: above(from), to: above(to), width, thickness: 0 }
      return create(PieceSchema, { name, shape: { case: 'plank', value } })
    }
    case 'lava':
    case 'water': {
      const half = (a: number, b: number) => Math.max(LEAST_M, Math.abs(a - b)) / 2
      const surface = Math.max(from.y, to.y) + POOL_ABOVE_M
      const centre = { x: (from.x + to.x) / 2, y: surface, z: (from.z + to.z) / 2 }
      const depth = surface - Math.min(from.y, to.y) + POOL_DEPTH_M
      const [halfX, halfZ] = [half(from.x, to.x), half(from.z, to.z)]
      const value = { centre, halfX, halfZ, depth, lava: kind === 'lava' }
      return create(PieceSchema, { name, shape: { case: 'pool', value } })
    }
  }
}

/** A name that no piece has: the kind and a number. */
export function freeName(kind: PieceKind, pieces: readonly Piece[]): string {
  const taken = new Set(pieces.map(({ name }) => name))
  let number = 1
  while (taken.has(`${kind} ${number}`)) number += 1
  return `${kind} ${number}`
}

const ORIGIN: Place = { x: 0, y: 0, z: 0 }

/** Around a piece, with some room. */
export function boxOf({ shape }: Piece): Box | undefined {
  const around = (places: readonly Place[], room: number): Box => {
    const [xs, ys, zs] = [places.map(({ x }) => x), places.map(({ y }) => y), places.map(({ z }) => z)]
    return {
      low: { x: Math.min(...xs) - room, y: Math.min(...ys) - room, z: Math.min(...zs) - room },
      high: { x: Math.max(...xs) + room, y: Math.max(...ys) + room, z: Math.max(...zs) + room },
    }
  }
  switch (shape.case) {
    case 'block': {
      const { foot = ORIGIN, width, depth, height } = shape.value
      return around([foot, { ...foot, y: foot.y + height }], Math.hypot(width, depth) / 2)
    }
    case 'plank':
      return around([shape.value.from ?? ORIGIN, shape.value.to ?? ORIGIN], shape.value.width)
    case 'pool':
      return around([shape.value.centre ?? ORIGIN], Math.max(shape.value.halfX, shape.value.halfZ, shape.value.depth))
    case undefined:
      return undefined
  }
}

/** Around all pieces that only one of two lists has; undefined: they are equal. */
export function changedBox(before: readonly Piece[], after: readonly Piece[]): Box | undefined {
  const lacks = (list: readonly Piece[], piece: Piece) => !list.some((other) => equals(PieceSchema, other, piece))
  const changed = [...before.filter((it) => lacks(after, it)), ...after.filter((it) => lacks(before, it))]
  const boxes = changed.map(boxOf).filter((box) => box !== undefined)
  const pick = (choose: (a: number, b: number) => number) => (a: Place, b: Place) => ({
    x: choose(a.x, b.x),
    y: choose(a.y, b.y),
    z: choose(a.z, b.z),
  })
  return boxes.reduce<Box | undefined>(
    (sum, box) =>
      sum === undefined ? box : { low: pick(Math.min)(sum.low, box.low), high: pick(Math.max)(sum.high, box.high) },
    undefined,
  )
}

/** What lies on a map, as the server had it at one moment. */
export interface Laid {
  worldId: bigint
  pieces: readonly Piece[]
  revision: bigint
  /** Hash of the map with its pieces; empty if the server does not support pieces. */
  mapHash: string
}

export class Pieces {
  /** Undefined until it is known. */
  readonly laid = signal<Laid | undefined>(undefined)
  readonly kind = signal<PieceKind>('block')
  readonly sizes = signal<Sizes>({ width: 4, height: 3 })
  /** The first of two clicks. */
  readonly begun = signal<Place | undefined>(undefined)
  private loading = false

  constructor(
    private readonly context: Context,
    /** Called when the map looks different within a box. */
    private readonly onChange: (box: Box) => void,
  ) {}

  choose(kind: PieceKind): void {
    batch(() => {
      this.kind.value = kind
      this.begun.value = undefined
    })
  }

  /** Asks for the pieces on a world's map. */
  async load(worldId: bigint, signal: AbortSignal): Promise<void> {
    try {
      const answer = await this.context.world.calls.listPieces({ worldId }, { signal })
      if (signal.aborted) return
      const { pieces, mapRevision: revision, editedMapHash: mapHash } = answer
      const before = this.laid.peek()
      this.laid.value = { worldId, pieces, revision, mapHash }
      const changed = before?.worldId === worldId ? changedBox(before.pieces, pieces) : undefined
      if (changed !== undefined) this.onChange(changed)
    } catch (error) {
      if (signal.aborted) return
      if (failureOf(error) !== 'unsupported') report(this.context, 'Pieces cannot be listed', error)
      this.laid.value ??= { worldId, pieces: [], revision: 0n, mapHash: '' }
    }
  }

  /** The map of the world has this revision now. */
  async take(worldId: bigint, revision: bigint, signal: AbortSignal): Promise<void> {
    const laid = this.laid.peek()
    if (laid === undefined || laid.revision === revision || this.loading) return
    this.loading = true
    await this.load(worldId, signal)
    this.loading = false
  }

  /** A click on the map. */
  async click(worldId: bigint, at: Place): Promise<void> {
    const [kind, first] = [this.kind.peek(), this.begun.peek()]
    if (PAIRED.has(kind) && first === undefined) {
      this.begun.value = at
      return
    }
    this.begun.value = undefined
    const name = freeName(kind, this.laid.peek()?.pieces ?? [])
    const piece = pieceBetween(kind, name, first ?? at, at, this.sizes.peek())
    await this.edit(worldId, `${name} cannot be put there`, { put: [piece] })
  }

  async remove(worldId: bigint, name: string): Promise<void> {
    await this.edit(worldId, `${name} cannot be taken away`, { remove: [name] })
  }

  async clear(worldId: bigint): Promise<void> {
    await this.edit(worldId, 'The pieces cannot be removed', { clear: true })
  }

  forget(): void {
    batch(() => {
      this.laid.value = undefined
      this.begun.value = undefined
    })
  }

  private async edit(
    worldId: bigint,
    failure: string,
    edit: { put?: Piece[]; remove?: string[]; clear?: boolean },
  ): Promise<void> {
    try {
      const { movedNpcIds } = await this.context.world.calls.editMap({ worldId, ...edit })
      if (movedNpcIds.length > 0) this.context.toasts.say(`${movedNpcIds.length} NPCs had to step aside.`)
    } catch (error) {
      report(this.context, failure, error)
    }
  }
}
