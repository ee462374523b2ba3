// The triangles of a map of the program, and rays that are cast at them: the scene of a page that shows this map.

import type { GetMeshResponse } from '../src/gen/surefoot/world/v1/world_pb.ts'
import { RAY_RANGE_M, type RayHits } from '../src/agents/rays.ts'

/** Values of a triangle: a corner and the two edges that leave it. */
const TRIANGLE_LEN = 9
const RAYS_PER_AGENT = 64

export class Mesh {
  private triangles: Float64Array = new Float64Array()
  private surfaces: Uint8Array = new Uint8Array()

  add({ positions, indices, surfaces }: GetMeshResponse): void {
    const [places, corners] = [new Float32Array(aligned(positions)), new Uint32Array(aligned(indices))]
    const added = new Float64Array(surfaces.length * TRIANGLE_LEN)
    for (let idx = 0; idx < surfaces.length; idx++) {
      for (let axis = 0; axis < 3; axis++) {
        const [a, b, c] = [0, 1, 2].map((corner) => places[3 * corners[3 * idx + corner]! + axis]!)
        const at = idx * TRIANGLE_LEN + axis
        added[at] = a!
        added[at + 3] = b! - a!
        added[at + 6] = c! - a!
      }
    }
    this.triangles = joined(Float64Array, this.triangles, added)
    this.surfaces = joined(Uint8Array, this.surfaces, surfaces)
  }

  cast = (origins: Float32Array, directions: Float32Array): RayHits => {
    const rayCount = origins.length / 3
    const hits = { distances: new Float64Array(rayCount).fill(Infinity), surfaces: new Uint8Array(rayCount) }
    for (let first = 0; first < rayCount; first += RAYS_PER_AGENT) {
      const origin = [...origins.subarray(3 * first, 3 * first + 3)] as [number, number, number]
      const near = this.near(origin)
      for (let ray = first; ray < first + RAYS_PER_AGENT; ray++) {
        const direction = directions.subarray(3 * ray, 3 * ray + 3)
        for (const triangle of near) {
          const far = this.hit(triangle * TRIANGLE_LEN, origin, direction)
          if (far >= hits.distances[ray]! || far > RAY_RANGE_M) continue
          hits.distances[ray] = far
          hits.surfaces[ray] = this.surfaces[triangle]!
        }
      }
    }
    return hits
  }

  /** Triangles whose bounds reach into the box around all rays from an origin. */
  private near(origin: readonly number[]): number[] {
    const found: number[] = []
    for (let triangle = 0; triangle < this.surfaces.length; triangle++) {
      let isNear = true
      for (let axis = 0; axis < 3 && isNear; axis++) {
        const at = triangle * TRIANGLE_LEN + axis
        const [a, b, c] = [0, this.triangles[at + 3]!, this.triangles[at + 6]!]
        const offset = this.triangles[at]! - origin[axis]!
        isNear = offset + Math.min(a, b, c) <= RAY_RANGE_M && offset + Math.max(a, b, c) >= -RAY_RANGE_M
      }
      if (isNear) found.push(triangle)
    }
    return found
  }

  /** The distance to the front of a triangle by Möller and Trumbore's test; infinite if the ray misses it. */
  private hit(at: number, [ox, oy, oz]: readonly [number, number, number], direction: Float32Array): number {
    const all = this.triangles
    const [bx, by, bz] = [all[at + 3]!, all[at + 4]!, all[at + 5]!]
    const [cx, cy, cz] = [all[at + 6]!, all[at + 7]!, all[at + 8]!]
    const [dx, dy, dz] = [direction[0]!, direction[1]!, direction[2]!]
    const [px, py, pz] = [dy * cz - dz * cy, dz * cx - dx * cz, dx * cy - dy * cx]
    const determinant = bx * px + by * py + bz * pz
    if (determinant <= 1e-12) return Infinity
    const [tx, ty, tz] = [ox - all[at]!, oy - all[at + 1]!, oz - all[at + 2]!]
    const u = tx * px + ty * py + tz * pz
    if (u < 0 || u > determinant) return Infinity
    const [qx, qy, qz] = [ty * bz - tz * by, tz * bx - tx * bz, tx * by - ty * bx]
    const v = dx * qx + dy * qy + dz * qz
    if (v < 0 || u + v > determinant) return Infinity
    const far = (cx * qx + cy * qy + cz * qz) / determinant
    return far >= 0 ? far : Infinity
  }
}

function aligned(bytes: Uint8Array): ArrayBuffer {
  return bytes.slice().buffer
}

function joined<T extends Float64Array | Uint8Array>(kind: new (length: number) => T, a: T, b: T): T {
  const both = new kind(a.length + b.length)
  both.set(a)
  both.set(b, a.length)
  return both
}
