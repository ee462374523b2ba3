// Poses of all NPCs of a world as they came, in one ring: the newest overwrites the oldest, so memory is bounded.

import type { Ability } from '../../gen/surefoot/world/v1/map_pb'
import { type Npc, NpcStatus, type Support } from '../../gen/surefoot/world/v1/world_pb'
import type { Place } from '../../view/viewport.types'

/** Poses that are kept, 55 bytes each: 200 s of 128 NPCs, or 26 s of 1,000. */
const CAPACITY = 1 << 19
/** NPCs that may come and go before everything is forgotten. */
const MOST_NPCS = 1 << 16
/** Poses farther apart than this are not joined: the NPC was put elsewhere, m. */
const SNAP_M = 5
/** A track goes on for this long after the end of its attempt, ticks: it may end in a fall. */
const AFTER_TICKS = 45
/** Longest track, ticks. */
const LONGEST_TICKS = 60 * 60 * 10
/** Waypoint of an NPC that has none. */
const NOWHERE: Place = { x: NaN, y: NaN, z: NaN }

/** How an NPC moved at a tick. */
export interface Pose {
  tick: number
  /** Heading, rad; 0 faces +z, counter-clockwise seen from above. */
  yaw: number
  /** Horizontal speed, m/s. */
  speed: number
  support: Support
  ability: Ability
  /** Undefined while it follows no plan. */
  waypoint: Place | undefined
}

/** An attempt as the page received it. */
export interface Attempt {
  attempt: number
  /** Positions, one per tick (1/60 s), three numbers each. */
  track: Float32Array
  /** What was received, in order; NPCs that do not change send nothing. */
  poses: readonly Pose[]
  /** Whether its first poses came before the page listened, or are forgotten. */
  isCut: boolean
}

interface Ring {
  npcs: Int32Array
  ticks: Float64Array
  attempts: Uint32Array
  seeking: Uint8Array
  places: Float32Array
  yaws: Float32Array
  speeds: Float32Array
  supports: Uint8Array
  abilities: Uint8Array
  /** Not numbers where there is no waypoint. */
  waypoints: Float32Array
}

export class Recorder {
  private ring: Ring | undefined
  private readonly numbers = new Map<bigint, number>()
  private taken = 0
  private latest = -Infinity

  constructor(private readonly capacity = CAPACITY) {}

  /** Takes in the pose of an NPC at a tick. */
  take(tick: number, npc: Npc): void {
    const { npcId, position, attemptsBegun, status } = npc
    // A restarted server counts from zero.
    if (tick < this.latest || this.numbers.size >= MOST_NPCS) this.forget()
    if (position === undefined) return
    this.latest = tick
    const ring = (this.ring ??= ringOf(this.capacity))
    const at = this.taken % this.capacity
    this.taken += 1
    ring.npcs[at] = this.numberOf(npcId)
    ring.ticks[at] = tick
    ring.attempts[at] = attemptsBegun
    ring.seeking[at] = status === NpcStatus.SEEKING ? 1 : 0
    putPlace(ring.places, at, position)
    putPlace(ring.waypoints, at, npc.waypoint ?? NOWHERE)
    ring.yaws[at] = npc.yaw
    ring.speeds[at] = Math.hypot(npc.velocity?.x ?? 0, npc.velocity?.z ?? 0)
    ring.supports[at] = npc.support
    ring.abilities[at] = npc.ability
  }

  /** What was received of an attempt of an NPC; undefined: too little to be shown. */
  attempt(npcId: bigint, attempt: number): Attempt | undefined {
    const [ring, number] = [this.ring, this.numbers.get(npcId)]
    if (ring === undefined || number === undefined || attempt === 0) return undefined
    const found: number[] = []
    let isCut = true
    let ended = Infinity
    for (const at of this.entries()) {
      if (ring.npcs[at] !== number) continue
      if (ring.attempts[at]! < attempt) isCut = false
      if (ring.attempts[at] !== attempt || ring.ticks[at]! > ended) continue
      if (ring.seeking[at] === 0) ended = Math.min(ended, ring.ticks[at]! + AFTER_TICKS)
      found.push(at)
    }
    if (found.length < 2) return undefined
    return { attempt, track: trackOf(ring, found), poses: found.map((at) => poseAt(ring, at)), isCut }
  }

  forget(): void {
    this.numbers.clear()
    this.taken = 0
    this.latest = -Infinity
  }

  private numberOf(npcId: bigint): number {
    const known = this.numbers.get(npcId)
    if (known !== undefined) return known
    const number = this.numbers.size
    this.numbers.set(npcId, number)
    return number
  }

  /** Places in the ring, the oldest first. */
  private *entries(): Generator<number> {
    const first = Math.max(0, this.taken - this.capacity)
    for (let index = first; index < this.taken; index += 1) yield index % this.capacity
  }
}

function ringOf(capacity: number): Ring {
  return {
    npcs: new Int32Array(capacity),
    ticks: new Float64Array(capacity),
    attempts: new Uint32Array(capacity),
    seeking: new Uint8Array(capacity),
    places: new Float32Array(capacity * 3),
    yaws: new Float32Array(capacity),
    speeds: new Float32Array(capacity),
    supports: new Uint8Array(capacity),
    abilities: new Uint8Array(capacity),
    waypoints: new Float32Array(capacity * 3),
  }
}

function putPlace(places: Float32Array, at: number, { x, y, z }: Place): void {
  places[at * 3] = x
  places[at * 3 + 1] = y
  places[at * 3 + 2] = z
}

function poseAt({ ticks, yaws, speeds, supports, abilities, waypoints }: Ring, at: number): Pose {
  const [x, y, z] = [waypoints[at * 3]!, waypoints[at * 3 + 1]!, waypoints[at * 3 + 2]!]
  return {
    tick: ticks[at]!,
    yaw: yaws[at]!,
    speed: speeds[at]!,
    support: supports[at]!,
    ability: abilities[at]!,
    waypoint: Number.isNaN(x) ? undefined : { x, y, z },
  }
}

/** Positions tick by tick between those that were received. */
function trackOf({ ticks, places }: Ring, entries: readonly number[]): Float32Array {
  const first = ticks[entries[0]!]!
  const length = Math.min(LONGEST_TICKS, ticks[entries[entries.length - 1]!]! - first + 1)
  const track = new Float32Array(length * 3)
  let next = 1
  for (let tick = 0; tick < length; tick += 1) {
    while (next < entries.length - 1 && ticks[entries[next]!]! - first < tick) next += 1
    const [from, to] = [entries[next - 1]!, entries[next]!]
    const span = ticks[to]! - ticks[from]!
    const share = span > 0 ? Math.min(1, Math.max(0, (tick + first - ticks[from]!) / span)) : 1
    const axes = [0, 1, 2].map((axis) => [places[from * 3 + axis]!, places[to * 3 + axis]!] as const)
    const isJoined = Math.hypot(...axes.map(([a, b]) => b - a)) <= SNAP_M
    axes.forEach(([a, b], axis) => {
      track[tick * 3 + axis] = isJoined ? a + (b - a) * share : share < 1 ? a : b
    })
  }
  return track
}
