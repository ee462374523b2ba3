// Where a ray meets the ground: boxes around tiles, then a grid of columns in each tile that is built on first use. No
// renderer here.

import type { Surface } from '../gen/surefoot/world/v1/world_pb'
import type { MeshTile, Place } from './viewport.types'

export interface Ray {
  origin: Place
  /** Of length 1. */
  direction: Place
}

export interface GroundHit {
  distance: number
  at: Place
  surface: Surface
  /** Whether the ray met the outside. */
  outside: boolean
}

/** Side of a column of a tile's grid, m. */
const COLUMN_M = 2
/** Columns of a grid along one side, at most. */
const MOST_COLUMNS = 64
const NEVER = Number.POSITIVE_INFINITY

interface Columns {
  across: number
  along: number
  side: number
  starts: Uint32Array
  faces: Uint32Array
}

/** The triangles of one tile, ready to be hit. */
export class GroundTile {
  readonly low: [number, number, number] = [NEVER, NEVER, NEVER]
  readonly high: [number, number, number] = [-NEVER, -NEVER, -NEVER]
  private columns: Columns | undefined

  constructor(private readonly tile: MeshTile) {
    for (const corner of tile.indices) {
      for (let axis = 0; axis < 3; axis += 1) {
        const value = tile.positions[corner * 3 + axis]!
        this.low[axis] = Math.min(this.low[axis]!, value)
        this.high[axis] = Math.max(this.high[axis]!, value)
      }
    }
  }

  /** Where the ray enters and leaves the box around the tile. */
  span(ray: Ray): [number, number] | undefined {
    let enter = 0
    let leave = NEVER
    const origin = [ray.origin.x, ray.origin.y, ray.origin.z]
    const direction = [ray.direction.x, ray.direction.y, ray.direction.z]
    for (let axis = 0; axis < 3; axis += 1) {
      const step = direction[axis]!
      const from = (this.low[axis]! - 1e-3 - origin[axis]!) / step
      const to = (this.high[axis]! + 1e-3 - origin[axis]!) / step
      if (Math.abs(step) < 1e-12) {
        if (origin[axis]! < this.low[axis]! || origin[axis]! > this.high[axis]!) {
          return undefined
        }
        continue
      }
      enter = Math.max(enter, Math.min(from, to))
      leave = Math.min(leave, Math.max(from, to))
    }
    return enter <= leave ? [enter, leave] : undefined
  }

  /** The nearest hit at or below `ceiling`, nearer than `nearest`. */
  cast(ray: Ray, [enter, leave]: [number, number], ceiling: number, nearest: number): GroundHit | undefined {
    const columns = (this.columns ??= this.sort())
    const walk = new ColumnWalk(ray, this.low, columns, enter)
    let best: GroundHit | undefined
    while (walk.inside) {
      const column = walk.x + walk.z * columns.across
      for (let at = columns.starts[column]!; at < columns.starts[column + 1]!; at += 1) {
        best = this.meet(ray, columns.faces[at]!, ceiling, best?.distance ?? nearest) ?? best
      }
      if ((best && best.distance <= walk.exit) || walk.exit > leave) {
        break
      }
      walk.step()
    }
    return best
  }

  private meet(ray: Ray, face: number, ceiling: number, nearest: number): GroundHit | undefined {
    const { positions, indices } = this.tile
    const a = indices[face * 3]! * 3
    const b = indices[face * 3 + 1]! * 3
    const c = indices[face * 3 + 2]! * 3
    const { origin: o, direction: d } = ray
    const ux = positions[b]! - positions[a]!
    const uy = positions[b + 1]! - positions[a + 1]!
    const uz = positions[b + 2]! - positions[a + 2]!
    const vx = positions[c]! - positions[a]!
    const vy = positions[c + 1]! - positions[a + 1]!
    const vz = positions[c + 2]! - positions[a + 2]!
    const px = d.y * vz - d.z * vy
    const py = d.z * vx - d.x * vz
    const pz = d.x * vy - d.y * vx
    const det = ux * px + uy * py + uz * pz
    if (Math.abs(det) < 1e-12) {
      return undefined
    }
    const tx = o.x - positions[a]!
    const ty = o.y - positions[a + 1]!
    const tz = o.z - positions[a + 2]!
    const u = (tx * px + ty * py + tz * pz) / det
    const qx = ty * uz - tz * uy
    const qy = tz * ux - tx * uz
    const qz = tx * uy - ty * ux
    const v = (d.x * qx + d.y * qy + d.z * qz) / det
    const distance = (vx * qx + vy * qy + vz * qz) / det
    const y = o.y + d.y * distance
    if (u < -1e-6 || v < -1e-6 || u + v > 1 + 1e-6 || distance <= 0 || distance >= nearest || y > ceiling) {
      return undefined
    }
    const at = { x: o.x + d.x * distance, y, z: o.z + d.z * distance }
    return { distance, at, surface: (this.tile.surfaces[face] ?? 1) as Surface, outside: det > 0 }
  }

  private sort(): Columns {
    const { positions, indices } = this.tile
    const extent = Math.max(this.high[0] - this.low[0], this.high[2] - this.low[2], 1e-3)
    const side = Math.max(COLUMN_M, extent / MOST_COLUMNS)
    const across = Math.floor((this.high[0] - this.low[0]) / side) + 1
    const along = Math.floor((this.high[2] - this.low[2]) / side) + 1
    const each = (visit: (column: number, face: number) => void): void => {
      for (let face = 0; face < indices.length / 3; face += 1) {
        const corners = [0, 1, 2].map((corner) => indices[face * 3 + corner]! * 3)
        const xs = corners.map((corner) => positions[corner]! - this.low[0])
        const zs = corners.map((corner) => positions[corner + 2]! - this.low[2])
        for (let z = Math.floor(Math.min(...zs) / side); z <= Math.floor(Math.max(...zs) / side); z += 1) {
          for (let x = Math.floor(Math.min(...xs) / side); x <= Math.floor(Math.max(...xs) / side); x += 1) {
            visit(x + z * across, face)
          }
        }
      }
    }
    const starts = new Uint32Array(across * along + 1)
    each((column) => (starts[column + 1]! += 1))
    for (let column = 0; column < across * along; column += 1) {
      starts[column + 1]! += starts[column]!
    }
    const next = starts.slice()
    const faces = new Uint32Array(starts[across * along]!)
    each((column, face) => {
      faces[next[column]!] = face
      next[column]! += 1
    })
    return { across, along, side, starts, faces }
  }
}

/** Goes through the columns that a ray crosses, in order. */
class ColumnWalk {
  x: number
  z: number
  private nextX: number
  private nextZ: number
  private readonly stepX: number
  private readonly stepZ: number
  private readonly acrossX: number
  private readonly acrossZ: number

  constructor(
    ray: Ray,
    low: readonly number[],
    private readonly columns: Columns,
    enter: number,
  ) {
    const { side, across, along } = columns
    const { direction } = ray
    const x = ray.origin.x + direction.x * enter - low[0]!
    const z = ray.origin.z + direction.z * enter - low[2]!
    this.x = Math.min(across - 1, Math.max(0, Math.floor(x / side)))
    this.z = Math.min(along - 1, Math.max(0, Math.floor(z / side)))
    this.stepX = Math.sign(direction.x)
    this.stepZ = Math.sign(direction.z)
    this.acrossX = this.stepX ? side / Math.abs(direction.x) : NEVER
    this.acrossZ = this.stepZ ? side / Math.abs(direction.z) : NEVER
    const first = (cell: number, step: number, at: number, speed: number): number =>
      step ? enter + ((cell + (step > 0 ? 1 : 0)) * side - at) / speed : NEVER
    this.nextX = first(this.x, this.stepX, x, direction.x)
    this.nextZ = first(this.z, this.stepZ, z, direction.z)
  }

  get inside(): boolean {
    return this.x >= 0 && this.z >= 0 && this.x < this.columns.across && this.z < this.columns.along
  }

  /** Where the ray leaves this column. */
  get exit(): number {
    return Math.min(this.nextX, this.nextZ)
  }

  step(): void {
    if (this.nextX === NEVER && this.nextZ === NEVER) {
      this.x = -1
    } else if (this.nextX < this.nextZ) {
      this.x += this.stepX
      this.nextX += this.acrossX
    } else {
      this.z += this.stepZ
      this.nextZ += this.acrossZ
    }
  }
}

/** The nearest hit of all tiles at or below `ceiling`; a ray that comes out of rock there hits nothing. */
export function castGround(tiles: Iterable<GroundTile>, ray: Ray, ceiling = NEVER): GroundHit | undefined {
  const crossed: { tile: GroundTile; span: [number, number] }[] = []
  for (const tile of tiles) {
    const span = tile.span(ray)
    if (span) {
      crossed.push({ tile, span })
    }
  }
  crossed.sort((a, b) => a.span[0] - b.span[0])
  let best: GroundHit | undefined
  for (const { tile, span } of crossed) {
    if (best && best.distance < span[0]) {
      break
    }
    best = tile.cast(ray, span, ceiling, best?.distance ?? NEVER) ?? best
  }
  return best?.outside === false ? undefined : best
}
