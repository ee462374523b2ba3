// From the triangles of a tile to what the terrain's shader takes: corners shared where the surface is smooth, and for
// each corner four bytes that say how steep, built, lit and hollow it is. No renderer here.

import { Surface } from '../gen/surefoot/world/v1/world_pb'
import { SUN } from './theme'
import type { MeshTile } from './viewport.types'

export interface ShadedTile {
  positions: Float32Array
  /** Four bytes a corner: upward part of the normal, built or grown, towards the sun or away, hollow or raised. */
  tones: Uint8Array
  indices: Uint32Array
  /** 1 for corners on the rim of the tile, where others go on. */
  rim: Uint8Array
}

/** Triangles of one corner that are closer than this in direction are shaded as one surface. */
const SMOOTH_COS = 0.5
/** The same for what is built. */
const BUILT_COS = 0.98
/** Triangles with edges longer than this, m, and so many times longer than usual in the tile are flat on purpose. */
const LONG_EDGE_M = 4
const LONG_EDGE_TIMES = 3
/** Share of a part's surface that is level or upright, above which it counts as built. */
const BUILT_SHARE = 0.8

interface Faces {
  /** Corner indices of the triangles that are drawn. */
  indices: Uint32Array
  normals: Float32Array
  areas: Float32Array
  flat: Uint8Array
}

/** Pools and devices are drawn as features, so only what is solid stays. */
function drawnIndices(tile: MeshTile): Uint32Array {
  const { indices, surfaces } = tile
  let kept = 0
  const drawn = new Uint32Array(indices.length)
  for (let face = 0; face < indices.length / 3; face += 1) {
    const surface = surfaces[face] ?? Surface.GROUND
    if ([Surface.GROUND, Surface.CLIMB, Surface.UNSPECIFIED].includes(surface)) {
      drawn.set(indices.subarray(face * 3, face * 3 + 3), kept)
      kept += 3
    }
  }
  return drawn.slice(0, kept)
}

function measureFaces(positions: Float32Array, indices: Uint32Array): Faces {
  const count = indices.length / 3
  const faces: Faces = {
    indices,
    normals: new Float32Array(count * 3),
    areas: new Float32Array(count),
    flat: new Uint8Array(count),
  }
  const lengths = new Float32Array(count)
  for (let face = 0; face < count; face += 1) {
    const a = indices[face * 3]! * 3
    const b = indices[face * 3 + 1]! * 3
    const c = indices[face * 3 + 2]! * 3
    const ux = positions[b]! - positions[a]!
    const uy = positions[b + 1]! - positions[a + 1]!
    const uz = positions[b + 2]! - positions[a + 2]!
    const vx = positions[c]! - positions[a]!
    const vy = positions[c + 1]! - positions[a + 1]!
    const vz = positions[c + 2]! - positions[a + 2]!
    const nx = uy * vz - uz * vy
    const ny = uz * vx - ux * vz
    const nz = ux * vy - uy * vx
    const length = Math.hypot(nx, ny, nz) || 1
    faces.normals[face * 3] = nx / length
    faces.normals[face * 3 + 1] = ny / length
    faces.normals[face * 3 + 2] = nz / length
    faces.areas[face] = length / 2
    lengths[face] = Math.max(Math.hypot(ux, uy, uz), Math.hypot(vx, vy, vz))
  }
  const usual = lengths.slice().sort()[Math.floor(count / 2)] ?? 0
  const long = Math.max(LONG_EDGE_M, usual * LONG_EDGE_TIMES)
  faces.flat.forEach((_, face) => (faces.flat[face] = lengths[face]! > long ? 1 : 0))
  return faces
}

/** Exactly upright, or exactly level: grown ground is seldom so. */
const isUpright = (up: number): boolean => Math.abs(up) < 0.01
const isLevel = (up: number): boolean => Math.abs(up) > 0.9999

/** The faces of each corner: those of corner i stand from `starts[i]` to `starts[i + 1]`. */
function facesOfCorners(indices: Uint32Array, corners: number): { starts: Uint32Array; faces: Uint32Array } {
  const starts = new Uint32Array(corners + 1)
  for (const corner of indices) {
    starts[corner + 1]! += 1
  }
  for (let corner = 0; corner < corners; corner += 1) {
    starts[corner + 1]! += starts[corner]!
  }
  const next = starts.slice()
  const faces = new Uint32Array(indices.length)
  indices.forEach((corner, at) => {
    faces[next[corner]!] = Math.floor(at / 3)
    next[corner]! += 1
  })
  return { starts, faces }
}

/** Marks the faces of parts that hang together and are mostly level or upright: houses and blocks. */
function markBuilt(faces: Faces, corners: number): void {
  const parents = Uint32Array.from({ length: corners }, (_, corner) => corner)
  const rootOf = (corner: number): number => {
    let root = corner
    while (parents[root] !== root) {
      parents[root] = parents[parents[root]!]!
      root = parents[root]!
    }
    return root
  }
  const { indices } = faces
  for (let at = 0; at < indices.length; at += 3) {
    const root = rootOf(indices[at]!)
    parents[rootOf(indices[at + 1]!)] = root
    parents[rootOf(indices[at + 2]!)] = rootOf(root)
  }
  const whole = new Float32Array(corners)
  const straight = new Float32Array(corners)
  faces.areas.forEach((area, face) => {
    const root = rootOf(indices[face * 3]!)
    const up = faces.normals[face * 3 + 1]!
    whole[root]! += area
    straight[root]! += isUpright(up) ? area : isLevel(up) ? area * 0.9 : 0
  })
  faces.flat.forEach((flat, face) => {
    const root = rootOf(indices[face * 3]!)
    const up = faces.normals[face * 3 + 1]!
    const built = straight[root]! > whole[root]! * BUILT_SHARE || (flat === 1 && (isUpright(up) || isLevel(up)))
    faces.flat[face] = built ? 2 : flat
  })
}

/** Marks the corners on open edges: all others have each neighbour once before and once after them. */
function findRim({ indices }: Faces, corners: number): Uint8Array {
  const balance = new Float64Array(corners)
  for (let at = 0; at < indices.length; at += 3) {
    for (let side = 0; side < 3; side += 1) {
      balance[indices[at + side]!]! += indices[at + ((side + 1) % 3)]! - indices[at + ((side + 2) % 3)]!
    }
  }
  return Uint8Array.from(balance, (sum) => (sum === 0 ? 0 : 1))
}

/** How far each corner lies below (negative) or above its neighbours along its normal, by their distance. */
function measureHollows(positions: Float32Array, faces: Faces): Float32Array {
  const corners = positions.length / 3
  const sums = new Float32Array(corners * 7)
  for (let at = 0; at < faces.indices.length; at += 1) {
    const face = Math.floor(at / 3)
    const corner = faces.indices[at]!
    const neighbour = faces.indices[face * 3 + ((at + 1) % 3)]!
    for (let axis = 0; axis < 3; axis += 1) {
      const step = positions[neighbour * 3 + axis]! - positions[corner * 3 + axis]!
      const normal = faces.normals[face * 3 + axis]! * faces.areas[face]!
      sums[corner * 7 + axis]! += step
      sums[neighbour * 7 + axis]! -= step
      sums[corner * 7 + 3 + axis]! += normal
      sums[neighbour * 7 + 3 + axis]! += normal
    }
    const length = Math.hypot(
      positions[neighbour * 3]! - positions[corner * 3]!,
      positions[neighbour * 3 + 1]! - positions[corner * 3 + 1]!,
      positions[neighbour * 3 + 2]! - positions[corner * 3 + 2]!,
    )
    sums[corner * 7 + 6]! += length
    sums[neighbour * 7 + 6]! += length
  }
  const hollows = new Float32Array(corners)
  for (let corner = 0; corner < corners; corner += 1) {
    const [x, y, z, nx, ny, nz, length] = sums.subarray(corner * 7, corner * 7 + 7) as unknown as number[]
    const size = Math.hypot(nx!, ny!, nz!) * length!
    hollows[corner] = size > 0 ? -(x! * nx! + y! * ny! + z! * nz!) / size : 0
  }
  return hollows
}

const toByte = (value: number): number => Math.round(Math.min(1, Math.max(0, value)) * 255)

/** Shades a tile; corners between surfaces that meet at an edge are doubled. */
export function shadeTile(tile: MeshTile): ShadedTile {
  const corners = tile.positions.length / 3
  const faces = measureFaces(tile.positions, drawnIndices(tile))
  markBuilt(faces, corners)
  const hollows = measureHollows(tile.positions, faces)
  const tileRim = findRim(faces, corners)
  const around = facesOfCorners(faces.indices, corners)
  const indices = new Uint32Array(faces.indices.length)
  const positions: number[] = []
  const tones: number[] = []
  const rim: number[] = []
  for (let corner = 0; corner < corners; corner += 1) {
    const own = around.faces.subarray(around.starts[corner]!, around.starts[corner + 1]!)
    for (const group of smoothGroups(own, faces)) {
      const index = positions.length / 3
      positions.push(tile.positions[corner * 3]!, tile.positions[corner * 3 + 1]!, tile.positions[corner * 3 + 2]!)
      tones.push(...toneOf(group, tileRim[corner] ? 0 : hollows[corner]!))
      rim.push(tileRim[corner]!)
      for (const face of group.faces) {
        for (let at = face * 3; at < face * 3 + 3; at += 1) {
          if (faces.indices[at] === corner) {
            indices[at] = index
          }
        }
      }
    }
  }
  return { positions: Float32Array.from(positions), tones: Uint8Array.from(tones), indices, rim: Uint8Array.from(rim) }
}

interface SmoothGroup {
  faces: number[]
  /** Direction of its first face. */
  seed: [number, number, number]
  /** Sum of directions by area. */
  sum: [number, number, number]
  flat: number
}

function smoothGroups(own: Uint32Array, faces: Faces): SmoothGroup[] {
  const groups: SmoothGroup[] = []
  for (const face of own) {
    const x = faces.normals[face * 3]!
    const y = faces.normals[face * 3 + 1]!
    const z = faces.normals[face * 3 + 2]!
    const flat = faces.flat[face]!
    const least = flat > 0 ? BUILT_COS : SMOOTH_COS
    const area = faces.areas[face]!
    const group = groups.find((it) => it.flat === flat && it.seed[0] * x + it.seed[1] * y + it.seed[2] * z > least)
    if (group) {
      group.faces.push(face)
      group.sum[0] += x * area
      group.sum[1] += y * area
      group.sum[2] += z * area
    } else {
      groups.push({ faces: [face], seed: [x, y, z], sum: [x * area, y * area, z * area], flat })
    }
  }
  return groups
}

function toneOf(group: SmoothGroup, hollow: number): number[] {
  const [x, y, z] = group.sum
  const length = Math.hypot(x, y, z) || 1
  const sun = (x * SUN[0] + y * SUN[1] + z * SUN[2]) / length
  const raised = group.flat > 0 ? 0 : hollow
  return [toByte(y / length / 2 + 0.5), group.flat === 2 ? 255 : 0, toByte(sun / 2 + 0.5), toByte(0.5 + raised)]
}
