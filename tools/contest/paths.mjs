// Paths that Detour finds on a NavMesh, as an engine's agent would follow them.

import { Detour, FloatArray, NavMeshQuery, Raw, UnsignedCharArray, UnsignedIntArray } from '@recast-navigation/core'
import { filter } from './navmesh.mjs'

/** Most polygons and corners of a path; the challenge allows 10,000 points. */
const MOST_POLYGONS = 16_384
const MOST_CORNERS = 8192
/** How far a place may be from the NavMesh, half the sides of a box in metres: first near by, then anywhere about. */
const SEARCHES = [
  { x: 0.5, y: 1, z: 0.5 },
  { x: 2, y: 4, z: 2 },
]
/** A goal that is farther than this from the end of a complete path is a point of its own, m: it counts as reached within 1 m. */
const END_TOLERANCE_M = 0.5

/** Answers goals on a NavMesh; `links` are those that it was made with. */
export class PathFinder {
  #polygons = new UnsignedIntArray()
  #corners = {
    at: sized(new FloatArray(), 3 * MOST_CORNERS),
    flags: sized(new UnsignedCharArray(), MOST_CORNERS),
    refs: sized(new UnsignedIntArray(), MOST_CORNERS),
  }
  #count = new Raw.IntRef()

  constructor(navMesh, links) {
    this.navMesh = navMesh
    this.links = links
    this.query = new NavMeshQuery(navMesh, { maxNodes: 65_535 })
    this.query.defaultFilter = filter()
  }

  /** The approach to a goal in the challenge's format, whether its path ends on the goal's polygon, and the time that Detour took. */
  approach({ start, goal }) {
    // Detour's wrapper leaves the array as long as the last path. An engine has buffers, so making room is no part of the query.
    this.#polygons.resize(MOST_POLYGONS)
    const begin = performance.now()
    const found = this.#find(start, goal)
    const micros = 1000 * (performance.now() - begin)
    if (found === undefined) return { approach: 'unreachable', isComplete: false, micros }
    const path = pathPoints(this.#cornersOf(found.count))
    const end = path.at(-1).at
    const gap = Math.hypot(...goal.map((value, axis) => value - end[axis]))
    if (found.isComplete && gap > END_TOLERANCE_M) path.push({ at: goal, by: 'walk' })
    return { approach: { path }, isComplete: found.isComplete, micros }
  }

  /** Finds the corners of the path from a start to a goal, and leaves them in the arrays; undefined if there is none. */
  #find(start, goal) {
    const [from, to] = [start, goal].map((at) => this.nearest(at))
    if (from === undefined || to === undefined) return undefined
    const { raw, defaultFilter } = this.query
    raw.findPath(from.ref, to.ref, from.at, to.at, defaultFilter.raw, this.#polygons.raw, MOST_POLYGONS)
    const length = this.#polygons.size
    if (length === 0) return undefined
    const last = this.#polygons.get(length - 1)
    const isComplete = last === to.ref
    // A partial path ends as close to the goal as its last polygon does.
    const end = isComplete ? to.at : this.#closest(last, goal)
    const { at, flags, refs } = this.#corners
    raw.findStraightPath(from.at, end, this.#polygons.raw, at.raw, flags.raw, refs.raw, this.#count, MOST_CORNERS, 0)
    const count = this.#count.value
    return count === 0 ? undefined : { count, isComplete }
  }

  /** The polygon nearest to a place, and its point nearest to it. */
  nearest([x, y, z], searches = SEARCHES) {
    for (const halfExtents of searches) {
      const { nearestRef, nearestPoint } = this.query.findNearestPoly({ x, y, z }, { halfExtents })
      if (nearestRef !== 0) return { ref: nearestRef, at: [nearestPoint.x, nearestPoint.y, nearestPoint.z] }
    }
    return undefined
  }

  #closest(ref, [x, y, z]) {
    const { closestPoint } = this.query.closestPointOnPoly(ref, { x, y, z })
    return [closestPoint.x, closestPoint.y, closestPoint.z]
  }

  /** The corners of the last path, and the links that begin at them. */
  #cornersOf(count) {
    const [at, flags, refs] = ['at', 'flags', 'refs'].map((name) => this.#corners[name].getHeapView())
    return Array.from({ length: count }, (_, corner) => {
      const isLink = (flags[corner] & Detour.DT_STRAIGHTPATH_OFFMESH_CONNECTION) !== 0
      return { at: [...at.subarray(3 * corner, 3 * corner + 3)], link: isLink ? this.#linkOf(refs[corner]) : undefined }
    })
  }

  #linkOf(ref) {
    return this.links[this.navMesh.getOffMeshConnectionByRef(ref).userId()]
  }

  free() {
    for (const array of [this.#polygons, ...Object.values(this.#corners)]) array.destroy()
    Raw.destroy(this.#count)
    this.query.destroy()
  }
}

function sized(array, length) {
  array.resize(length)
  return array
}

/**
 * The points of a path in the challenge's format. A corner where a link begins has the `link`. If that has `steps`, they follow the corner:
 * Detour moves the ends of links onto the NavMesh, and leaps begin where they begin. Otherwise the next corner is reached by the link's move.
 */
export function pathPoints(corners) {
  const millimetres = (value) => Math.round(value * 1000) / 1000
  const points = corners.flatMap(({ at, link }, corner) => {
    const before = corners[corner - 1]?.link
    const by = before === undefined || before.steps !== undefined ? 'walk' : before.by
    return [{ at, by }, ...(link?.steps ?? [])]
  })
  return points.map(({ at, by }) => ({ at: at.map(millimetres), by }))
}
