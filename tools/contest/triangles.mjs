// The triangles of a level in a grid of columns, for rays and for bodies in flight.

const SMALLEST_COLUMN_M = 1
const MOST_COLUMNS = 512
/** Hits that are closer to the start of a ray than this share of its length belong to the surface that it starts on. */
const SKIN = 1e-6

export class Triangles {
  #corners
  #columns

  /** Sorts triangles into upright columns, each of which knows those that reach into it. */
  constructor({ positions, indices }) {
    this.count = indices.length / 3
    this.#corners = new Float64Array(indices.length * 3)
    indices.forEach((vertex, at) => {
      for (let axis = 0; axis < 3; axis += 1) this.#corners[3 * at + axis] = positions[3 * vertex + axis]
    })
    this.#columns = columnsOf(this.#corners)
  }

  /** Height of the highest surface below `high` and not below `low` at x, z; undefined if there is none. */
  heightAt(x, z, high, low) {
    const hit = this.firstHit([x, high, z], [x, low, z])
    return hit?.at[1]
  }

  /** Where a segment first meets a triangle, and how level it is there: `level` is the cosine of the slope. */
  firstHit(from, to) {
    let nearest = 1
    let found = -1
    this.#near(Math.min(from[0], to[0]), Math.min(from[2], to[2]), Math.max(from[0], to[0]), Math.max(from[2], to[2]), (triangle) => {
      const share = segmentHit(this.#corners, 9 * triangle, from, to)
      if (share > SKIN && share <= nearest) [nearest, found] = [share, triangle]
      return false
    })
    if (found < 0) return undefined
    const at = from.map((start, axis) => start + nearest * (to[axis] - start))
    return { at, level: levelness(this.#corners, 9 * found) }
  }

  /** Whether an upright capsule touches a triangle: `radius` about the segment from `low` to `high` at x, z. */
  touch(x, z, low, high, radius) {
    const reaches = (triangle) => {
      const at = 9 * triangle
      const [lowest, highest] = heights(this.#corners, at)
      if (lowest > high + radius || highest < low - radius) return false
      // A pile of spheres, no farther apart than their radius, stands for the capsule.
      const steps = Math.max(1, Math.ceil((high - low) / radius))
      for (let step = 0; step <= steps; step += 1) {
        const y = low + ((high - low) * step) / steps
        if (lowest <= y + radius && highest >= y - radius && distanceSquared(this.#corners, at, x, y, z) < radius * radius) return true
      }
      return false
    }
    return this.#near(x - radius, z - radius, x + radius, z + radius, reaches)
  }

  /** Calls `visit` with the triangles of all columns of a rectangle, some more than once, until it returns true. */
  #near(lowX, lowZ, highX, highZ, visit) {
    const { origin, size, width, depth, starts, members } = this.#columns
    const column = (value, axis, count) => Math.min(count - 1, Math.max(0, Math.floor((value - origin[axis]) / size)))
    const [left, right] = [column(lowX, 0, width), column(highX, 0, width)]
    const [near, far] = [column(lowZ, 1, depth), column(highZ, 1, depth)]
    for (let row = near; row <= far; row += 1) {
      const end = starts[row * width + right + 1]
      for (let at = starts[row * width + left]; at < end; at += 1) if (visit(members[at])) return true
    }
    return false
  }
}

/** Columns in rows: column `c` has the triangles `members[starts[c]..starts[c + 1]]`. */
function columnsOf(corners) {
  const low = [Infinity, Infinity]
  const high = [-Infinity, -Infinity]
  for (let at = 0; at < corners.length; at += 3) {
    low[0] = Math.min(low[0], corners[at])
    low[1] = Math.min(low[1], corners[at + 2])
    high[0] = Math.max(high[0], corners[at])
    high[1] = Math.max(high[1], corners[at + 2])
  }
  const size = Math.max(SMALLEST_COLUMN_M, (high[0] - low[0]) / MOST_COLUMNS, (high[1] - low[1]) / MOST_COLUMNS)
  const [width, depth] = [0, 1].map((axis) => Math.floor((high[axis] - low[axis]) / size) + 1)
  const eachColumn = (visit) => {
    for (let triangle = 0; 9 * triangle < corners.length; triangle += 1) {
      const at = 9 * triangle
      const span = (axis) => {
        const values = [corners[at + axis], corners[at + 3 + axis], corners[at + 6 + axis]]
        const column = (value) => Math.floor((value - low[axis / 2]) / size)
        return [column(Math.min(...values)), column(Math.max(...values))]
      }
      const [left, right] = span(0)
      const [near, far] = span(2)
      for (let row = near; row <= far; row += 1) {
        for (let column = left; column <= right; column += 1) visit(row * width + column, triangle)
      }
    }
  }
  const starts = new Uint32Array(width * depth + 1)
  eachColumn((column) => (starts[column + 1] += 1))
  for (let column = 0; column < width * depth; column += 1) starts[column + 1] += starts[column]
  const members = new Uint32Array(starts[width * depth])
  const filled = starts.slice()
  eachColumn((column, triangle) => {
    members[filled[column]] = triangle
    filled[column] += 1
  })
  return { origin: low, size, width, depth, starts, members }
}

function heights(corners, at) {
  const [a, b, c] = [corners[at + 1], corners[at + 4], corners[at + 7]]
  return [Math.min(a, b, c), Math.max(a, b, c)]
}

/** Cosine of a triangle's slope; triangles have no upper side here. */
function levelness(c, at) {
  const [ux, uy, uz] = [c[at + 3] - c[at], c[at + 4] - c[at + 1], c[at + 5] - c[at + 2]]
  const [vx, vy, vz] = [c[at + 6] - c[at], c[at + 7] - c[at + 1], c[at + 8] - c[at + 2]]
  const normal = [uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx]
  return Math.abs(normal[1]) / Math.hypot(...normal)
}

/** The share of a segment up to a triangle (Moeller and Trumbore, 1997), or NaN. */
function segmentHit(c, at, from, to) {
  const [dx, dy, dz] = [to[0] - from[0], to[1] - from[1], to[2] - from[2]]
  const [ux, uy, uz] = [c[at + 3] - c[at], c[at + 4] - c[at + 1], c[at + 5] - c[at + 2]]
  const [vx, vy, vz] = [c[at + 6] - c[at], c[at + 7] - c[at + 1], c[at + 8] - c[at + 2]]
  const [px, py, pz] = [dy * vz - dz * vy, dz * vx - dx * vz, dx * vy - dy * vx]
  const determinant = ux * px + uy * py + uz * pz
  if (Math.abs(determinant) < 1e-12) return NaN
  const [sx, sy, sz] = [from[0] - c[at], from[1] - c[at + 1], from[2] - c[at + 2]]
  const u = (sx * px + sy * py + sz * pz) / determinant
  const [qx, qy, qz] = [sy * uz - sz * uy, sz * ux - sx * uz, sx * uy - sy * ux]
  const v = (dx * qx + dy * qy + dz * qz) / determinant
  // Rays along an edge must not slip through between its two triangles.
  if (u < -1e-9 || v < -1e-9 || u + v > 1 + 1e-9) return NaN
  return (vx * qx + vy * qy + vz * qz) / determinant
}

/** Squared distance of a point from a triangle (Ericson, Real-Time Collision Detection, 5.1.5). */
function distanceSquared(c, at, x, y, z) {
  const [ax, ay, az] = [c[at] - x, c[at + 1] - y, c[at + 2] - z]
  const [ux, uy, uz] = [c[at + 3] - c[at], c[at + 4] - c[at + 1], c[at + 5] - c[at + 2]]
  const [vx, vy, vz] = [c[at + 6] - c[at], c[at + 7] - c[at + 1], c[at + 8] - c[at + 2]]
  const squared = (s, t) => (ax + s * ux + t * vx) ** 2 + (ay + s * uy + t * vy) ** 2 + (az + s * uz + t * vz) ** 2
  const d1 = -(ux * ax + uy * ay + uz * az)
  const d2 = -(vx * ax + vy * ay + vz * az)
  if (d1 <= 0 && d2 <= 0) return squared(0, 0)
  const [uu, uv, vv] = [ux * ux + uy * uy + uz * uz, ux * vx + uy * vy + uz * vz, vx * vx + vy * vy + vz * vz]
  const [d3, d4] = [d1 - uu, d2 - uv]
  if (d3 >= 0 && d4 <= d3) return squared(1, 0)
  const [d5, d6] = [d1 - uv, d2 - vv]
  if (d6 >= 0 && d5 <= d6) return squared(0, 1)
  const wc = d1 * d4 - d3 * d2
  if (wc <= 0 && d1 >= 0 && d3 <= 0) return squared(d1 / (d1 - d3), 0)
  const wb = d5 * d2 - d1 * d6
  if (wb <= 0 && d2 >= 0 && d6 <= 0) return squared(0, d2 / (d2 - d6))
  const wa = d3 * d6 - d5 * d4
  if (wa <= 0 && d4 - d3 >= 0 && d5 - d6 >= 0) {
    const t = (d4 - d3) / (d4 - d3 + d5 - d6)
    return squared(1 - t, t)
  }
  const sum = wa + wb + wc
  return squared(wb / sum, wc / sum)
}
