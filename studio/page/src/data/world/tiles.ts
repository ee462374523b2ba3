// Which tiles of a map to load, and how they come over the wire.

import type { GetFeaturesResponse, GetMeshResponse } from '../../gen/surefoot/world/v1/world_pb'
import type { Features, MeshTile, Place } from '../../view/viewport.types'

/** Side of a tile seen from above, m. */
export const TILE_M = 64
/** Maps up to this size come at full detail at once, m. */
const SMALL_MAP_M = 300
/** Detail of larger maps at first, m. */
const COARSE_CELL_M = 4

export interface Extent {
  width: number
  height: number
  depth: number
}

/** A square of tiles, corners included. */
export interface TileRange {
  lowX: number
  lowZ: number
  highX: number
  highZ: number
}

/** Detail to load a whole map with first, m; 0: as it is. */
export function firstCell(size: Extent): number {
  return Math.max(size.width, size.depth) <= SMALL_MAP_M ? 0 : COARSE_CELL_M
}

/** The smallest range with every tile around a place that is not there yet; undefined: all are. */
export function missingTiles(
  around: Place,
  radius: number,
  size: Extent,
  has: (tile: string) => boolean,
): TileRange | undefined {
  const low = { ...around, x: around.x - radius, z: around.z - radius }
  const high = { ...around, x: around.x + radius, z: around.z + radius }
  const within = tilesWithin({ low, high }, size)
  let range: TileRange | undefined
  for (let x = within.lowX; x <= within.highX; x += 1) {
    for (let z = within.lowZ; z <= within.highZ; z += 1) {
      if (has(`${x},${z}`)) continue
      range = {
        lowX: Math.min(range?.lowX ?? x, x),
        lowZ: Math.min(range?.lowZ ?? z, z),
        highX: Math.max(range?.highX ?? x, x),
        highZ: Math.max(range?.highZ ?? z, z),
      }
    }
  }
  return range
}

/** The tiles that a box touches. */
export function tilesWithin({ low, high }: { low: Place; high: Place }, size: Extent): TileRange {
  const last = (extent: number) => Math.max(0, Math.ceil(extent / TILE_M) - 1)
  const tile = (metres: number, extent: number) => Math.min(last(extent), Math.max(0, Math.floor(metres / TILE_M)))
  return {
    lowX: tile(low.x, size.width),
    lowZ: tile(low.z, size.depth),
    highX: tile(high.x, size.width),
    highZ: tile(high.z, size.depth),
  }
}

/** The tiles of a range. */
export function* tilesOf({ lowX, lowZ, highX, highZ }: TileRange): Generator<string> {
  for (let x = lowX; x <= highX; x += 1) {
    for (let z = lowZ; z <= highZ; z += 1) yield `${x},${z}`
  }
}

/** Whether two ranges share a tile. */
export function overlap(a: TileRange, b: TileRange): boolean {
  return a.lowX <= b.highX && b.lowX <= a.highX && a.lowZ <= b.highZ && b.lowZ <= a.highZ
}

/** The box of a range, a little smaller, so that it does not touch the tiles beside it. */
export function boxOf(range: TileRange, size: Extent): { low: Place; high: Place } {
  const inside = 0.5
  return {
    low: { x: range.lowX * TILE_M + inside, y: -size.height, z: range.lowZ * TILE_M + inside },
    high: { x: (range.highX + 1) * TILE_M - inside, y: 2 * size.height, z: (range.highZ + 1) * TILE_M - inside },
  }
}

/** A tile from the wire. Blobs are copied, since they need not be aligned where they lie in the message. */
export function readTile(message: GetMeshResponse): MeshTile {
  return {
    tileX: message.tileX,
    tileZ: message.tileZ,
    positions: new Float32Array(copy(message.positions)),
    indices: new Uint32Array(copy(message.indices)),
    surfaces: message.surfaces.slice(),
  }
}

/** Numbers of a blob of little-endian f32. */
export function readFloats(bytes: Uint8Array): Float32Array {
  return new Float32Array(copy(bytes))
}

function copy(bytes: Uint8Array): ArrayBuffer {
  const whole = new ArrayBuffer(bytes.byteLength - (bytes.byteLength % 4))
  new Uint8Array(whole).set(bytes.subarray(0, whole.byteLength))
  return whole
}

const ORIGIN: Place = { x: 0, y: 0, z: 0 }

export function readFeatures(message: GetFeaturesResponse): Features {
  const { width, height, depth } = message.size ?? { width: 250, height: 80, depth: 250 }
  return {
    size: { width, height, depth },
    pools: message.pools.map((pool) => ({
      centre: pool.centre ?? ORIGIN,
      halfX: pool.halfX,
      halfZ: pool.halfZ,
      round: pool.round,
      depth: pool.depth,
      lava: pool.lava,
    })),
    pads: message.pads.map((pad) => ({ centre: pad.centre ?? ORIGIN, speed: pad.speed })),
    zipLines: message.zipLines.map((line) => ({ from: line.from ?? ORIGIN, to: line.to ?? ORIGIN })),
    teleporters: message.teleporters.map((line) => ({
      from: line.from ?? ORIGIN,
      to: line.to ?? ORIGIN,
      twoWay: line.twoWay,
    })),
    jetpacks: message.jetpacks,
    spots: message.spots.map(({ tag, from, to, twoWay }) => ({ tag, from: from ?? ORIGIN, to, twoWay })),
  }
}
