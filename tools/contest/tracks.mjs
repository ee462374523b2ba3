// Tracks of bodies that follow Detour's paths as engines do, in the challenge's format: the body at the start and after every ten ticks, each as
// x, y, z, heading, velocity x, y, z, and 1 in the air, in m, rad and m/s. A heading of 0 looks along +z, and grows towards +x.

const TICK_S = 1 / 60
const TICKS_PER_DECISION = 10
/** Most decisions of a track: 300 s. */
const MOST_DECISIONS = 1800
/** Horizontal distance from the goal within which a body has arrived, m. */
const ARRIVED_M = 1
/** Horizontal speed below which a heading stays as it is, m/s. */
const SLOW = 0.1

/** The heading after a tick: it turns to the direction of motion at a constant rate, as engines turn characters. */
export function turned(yaw, [x, , z], turnSpeed) {
  if (Math.hypot(x, z) < SLOW) return yaw
  const off = Math.atan2(x, z) - yaw
  const shortest = Math.atan2(Math.sin(off), Math.cos(off))
  const most = turnSpeed * TICK_S
  return yaw + Math.min(most, Math.max(-most, shortest))
}

/**
 * The track of a body that begins at rest. `tick` moves it by one tick and returns its position and velocity; undefined at the end of its way.
 */
export function trackOf({ start, yaw, goal }, turnSpeed, tick) {
  const track = [sample(start, yaw, [0, 0, 0])]
  let heading = yaw
  while (track.length <= MOST_DECISIONS) {
    let at
    let velocity
    for (let count = 0; count < TICKS_PER_DECISION; count += 1) {
      const moved = tick()
      // A decision in which the way ends counts as a whole one.
      if (moved === undefined) return at === undefined ? track : [...track, sample(at, heading, velocity)]
      ;({ at, velocity } = moved)
      heading = turned(heading, velocity, turnSpeed)
    }
    track.push(sample(at, heading, velocity))
    if (Math.hypot(at[0] - goal[0], at[2] - goal[2]) <= ARRIVED_M) return track
  }
  return track
}

function sample(at, yaw, velocity) {
  const short = (value) => Math.round(value * 1e4) / 1e4
  return [...at, Math.atan2(Math.sin(yaw), Math.cos(yaw)), ...velocity, 0].map(short)
}

/** The track along the points of a path at a constant speed, m/s, without any slowing down or smoothing. */
export function alongPath(goal, points, { speed, turnSpeed }) {
  let next = 0
  let at = goal.start
  return trackOf(goal, turnSpeed, () => {
    let left = speed * TICK_S
    let direction
    while (next < points.length) {
      const to = points[next].map((value, axis) => value - at[axis])
      const distance = Math.hypot(...to)
      if (distance > 0) direction = to.map((value) => value / distance)
      if (distance > left) {
        at = at.map((value, axis) => value + left * direction[axis])
        break
      }
      at = points[next]
      left -= distance
      next += 1
    }
    // The last point may be where the body is.
    return direction && { at, velocity: direction.map((value) => value * speed) }
  })
}

/** Top speed of the agents, m/s, that reach it with an acceleration of 30 m/s2. Slower ones take as long. */
const FAST = 11

/** An agent of DetourCrowd at most as fast as `speed`, m/s, with its best obstacle avoidance and all that shortens paths. */
export function crowdAgent({ radius, height, speed }) {
  return {
    radius,
    height,
    maxAcceleration: (30 * speed) / FAST,
    maxSpeed: speed,
    collisionQueryRange: 6,
    pathOptimizationRange: 30,
    separationWeight: 1,
    updateFlags: 1 | 2 | 4 | 8 | 16,
    obstacleAvoidanceType: 3,
  }
}

/** The track of the only agent of a crowd, from and to places on the NavMesh. */
export function inCrowd(crowd, goal, { from, to }, { agent, turnSpeed }) {
  const place = ([x, y, z]) => ({ x, y, z })
  const only = crowd.addAgent(place(from), agent)
  only.requestMoveTarget(place(to))
  const track = trackOf(goal, turnSpeed, () => {
    crowd.update(TICK_S)
    const [at, velocity] = [only.position(), only.velocity()]
    return { at: [at.x, at.y, at.z], velocity: [velocity.x, velocity.y, velocity.z] }
  })
  crowd.removeAgent(only)
  return track
}
