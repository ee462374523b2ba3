// Jump links at the edges of a NavMesh, generated as recent engines do.
//
// The public descriptions that this follows:
// - Unreal Engine 5.5, "Automatic Navigation Link Generation": trajectories are sampled along the edges of the NavMesh, a multiple of the cell
//   size apart ("Sampling Separation Factor"); each starts near the edge, is a parabola, and looks for ground down to "Jump Max Depth", with a
//   tolerance of height at both ends; similar links are filtered by the distance of their ends ("Filter Distance Threshold"). Its links lead down.
// - Unreal Engine 5.7, `FNavLinkGenerationJumpConfig`: a link of a ledge also has an upward direction, with an area of its own.
// - Unity, `NavMeshBuildSettings.ledgeDropHeight` and `maxJumpAcrossDistance`: a drop lands just beyond the edge, lower by more than a step; a
//   jump across a gap is longer than the body is wide, and lands at the level of its start.
// Engines have one parabola for each set of settings. Here the parabolas are those of the body: it runs off the edge or jumps at its own speeds
// under its own gravity, and what it hits are the level's triangles rather than voxels.

const SETTINGS = {
  /** Distance of the samples along an edge, in cells. Unreal's default is 1, at which it warns of the time that it takes. */
  samplingSeparation: 2,
  /** Links whose starts and whose ends are both closer than this count as one, m. Unreal's default is 0.8 m. */
  filterDistance: 0.8,
  /** Deepest fall, m. Unreal's default is 1.5 m; here bodies survive every fall, and this one takes 1.7 s under the default body's gravity. */
  maxDepth: 30,
  /** Speeds over the edge, as shares of the body's top speed. The first that lands is taken. */
  dropSpeeds: [0.25, 0.5, 1],
  jumpSpeeds: [0.5, 0.75, 1],
}
/** Length of the steps in which a body walks to the edge of a cliff, m. */
const STRIDE_M = 0.1
/** Time between two checks of a flight, s: a tick of the simulation. */
const TICK_S = 1 / 60

/**
 * Links from the edges of a NavMesh to ground below or across a gap, and from lower ground to them, all one-way. `edges` come from `boundary`, `triangles` are the level's,
 * `body` is a character profile, `agent` has Recast's parameters, and `nearest` returns the point of the NavMesh nearest to a landing, if
 * there is one that close.
 */
export function jumpLinks({ edges, triangles, body, agent, nearest }) {
  const level = { triangles, body, climb: agent.walkableClimb * agent.ch, nearest, reach: (agent.walkableRadius + 2) * agent.cs + body.radius }
  const drops = new Links(SETTINGS.filterDistance)
  const jumps = new Links(SETTINGS.filterDistance)
  const climbs = new Links(SETTINGS.filterDistance)
  for (const edge of edges) {
    for (const sample of samples(edge, SETTINGS.samplingSeparation * agent.cs)) {
      const lip = lipBeyond(level, sample, edge.outward)
      if (lip === undefined) continue
      drops.add(lip.start, landing(level, lip.start, lip.edge, edge.outward, 0), 'walk')
      jumps.add(lip.start, landing(level, lip.start, lip.start, edge.outward, body.jump_speed), 'jump')
      climbs.add(takeOff(level, lip.start, edge.outward), lip.start, 'jump')
    }
  }
  const radius = 2 * agent.cs
  return [...drops.all, ...jumps.all, ...climbs.all].map((link) => ({ ...link, radius, bidirectional: false }))
}

/** Points along an edge, the same distance apart and from its ends. */
function* samples({ from, to }, apart) {
  const count = Math.max(1, Math.floor(Math.hypot(to[0] - from[0], to[2] - from[2]) / apart))
  for (let at = 0; at < count; at += 1) {
    const share = (at + 0.5) / count
    yield from.map((value, axis) => value + share * (to[axis] - value))
  }
}

/** Where the ground ends beyond the edge of the NavMesh, which keeps a radius away from it; undefined at walls and where it does not end. */
function lipBeyond({ triangles, body, climb, reach }, [x, y, z], [outX, outZ]) {
  let floor = triangles.heightAt(x, z, y + climb, y - climb)
  if (floor === undefined) return undefined
  const start = [x, floor, z]
  for (let walked = STRIDE_M; walked <= reach; walked += STRIDE_M) {
    const [nextX, nextZ] = [x + walked * outX, z + walked * outZ]
    const next = triangles.heightAt(nextX, nextZ, floor + climb, floor - climb)
    if (isBlocked(triangles, body, climb, [nextX, next ?? floor, nextZ])) return undefined
    if (next === undefined) return { start, edge: [nextX, floor, nextZ] }
    floor = next
  }
  return undefined
}

/** Whether a body with its feet there would touch something that it cannot step on. */
function isBlocked(triangles, body, climb, [x, y, z]) {
  const low = y + climb + body.radius
  return triangles.touch(x, z, low, Math.max(low, y + body.height - body.radius), body.radius)
}

/** Where the body comes down on the NavMesh if it leaves the ground at `from`, at the first speed at which it does. */
function landing(level, start, from, outward, up) {
  const { climb, body, nearest } = level
  for (const share of up > 0 ? SETTINGS.jumpSpeeds : SETTINGS.dropSpeeds) {
    const hit = flight(level, from, outward, share * body.forward_speed, up)
    if (hit === undefined || hit.level < Math.cos(body.max_slope)) continue
    const fall = start[1] - hit.at[1]
    const isLower = fall > climb
    const isAcross = up > 0 && fall >= -climb && Math.hypot(hit.at[0] - start[0], hit.at[2] - start[2]) > 2 * body.radius
    const end = isLower || isAcross ? nearest(hit.at) : undefined
    if (end !== undefined) return end
  }
  return undefined
}

/** Where the body can jump up to a ledge from, at the first speed at which it lands there. */
function takeOff(level, ledge, [outX, outZ]) {
  const { triangles, climb, body, nearest } = level
  const up = body.jump_speed
  for (const share of SETTINGS.jumpSpeeds) {
    const speed = share * body.forward_speed
    // A body lands on its way down; a flight that ends at the height of its start is a jump across.
    for (let time = up / body.gravity; time < (2 * up) / body.gravity; time += TICK_S) {
      const rise = up * time - (body.gravity * time * time) / 2
      if (rise <= climb) break
      const [x, z] = [ledge[0] + speed * time * outX, ledge[2] + speed * time * outZ]
      const floor = triangles.heightAt(x, z, ledge[1] - rise + climb, ledge[1] - rise)
      const hit = floor === undefined ? undefined : flight(level, [x, floor, z], [-outX, -outZ], speed, up)
      // From higher ground than the parabola's start, the body passes the ledge a little and lands beyond it.
      const isOnLedge = hit !== undefined && Math.abs(hit.at[1] - ledge[1]) <= climb
      const start = isOnLedge ? nearest([x, floor, z]) : undefined
      if (start !== undefined) return start
    }
  }
  return undefined
}

/** What the feet meet on the way down, if the body meets nothing before. */
function flight({ triangles, body, climb }, from, [outX, outZ], speed, up) {
  let feet = from
  for (let tick = 1; feet[1] > from[1] - SETTINGS.maxDepth; tick += 1) {
    const time = tick * TICK_S
    const away = speed * time
    const next = [from[0] + away * outX, from[1] + up * time - (body.gravity * time * time) / 2, from[2] + away * outZ]
    const hit = triangles.firstHit(feet, next)
    if (hit !== undefined) return next[1] < feet[1] && hit.at[1] >= from[1] - SETTINGS.maxDepth ? hit : undefined
    if (isBlocked(triangles, body, climb, next)) return undefined
    feet = next
  }
  return undefined
}

/** Links without those that are similar to an earlier one. */
class Links {
  all = []
  #near = new Map()

  constructor(distance) {
    this.distance = distance
  }

  add(start, end, by) {
    if (start === undefined || end === undefined) return
    const cell = start.map((value) => Math.floor(value / this.distance))
    if (this.#neighbours(cell).some((other) => this.#isSimilar(other, start, end))) return
    const key = cell.join()
    this.#near.set(key, [...(this.#near.get(key) ?? []), { start, end }])
    const point = ([x, y, z]) => ({ x, y, z })
    this.all.push({ startPosition: point(start), endPosition: point(end), by })
  }

  #isSimilar(other, start, end) {
    const apart = (a, b) => Math.hypot(...a.map((value, axis) => value - b[axis]))
    return apart(other.start, start) < this.distance && apart(other.end, end) < this.distance
  }

  #neighbours([x, y, z]) {
    const around = [-1, 0, 1]
    return around.flatMap((i) => around.flatMap((j) => around.flatMap((k) => this.#near.get(`${x + i},${y + j},${z + k}`) ?? [])))
  }
}
