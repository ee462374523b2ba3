// Smooth motion from poses that arrive a few times a second: NPCs are shown about one message late, so that there is
// mostly a pose on either side to go between. No renderer here.

import { shortestTurn } from './orbit'
import type { NpcPose, NpcState, Place } from './viewport.types'

const TICKS_PER_MS = 0.06
/** NPCs are carried on by their velocity for so long if nothing arrives, ticks. */
const MOST_CARRIED = 6
/** Poses farther apart are not joined by a way: the NPC was put elsewhere, m. */
const SNAP_M = 5
/** How fast the step fades that comes about when what was carried on turns out otherwise, ms. */
const FADE_MS = 80
const KEPT_POSES = 6

/** Tells which tick to show at a moment: steady, never back, about one message behind the latest. */
export class TickClock {
  private latest = Number.NaN
  private arrived = 0
  private interval = 6
  private rate = TICKS_PER_MS
  private shown = Number.NaN
  private asked = 0

  receive(tick: number, now: number): void {
    const ticks = tick - this.latest
    const ms = now - this.arrived
    if (!(ticks >= 0) || ticks > 300) {
      this.shown = tick
      this.asked = now
      this.interval = 6
      this.rate = TICKS_PER_MS
    } else if (ticks > 0) {
      this.interval += (ticks - this.interval) * 0.2
      if (ms > 1) {
        this.rate += (Math.min(4 * TICKS_PER_MS, ticks / ms) - this.rate) * 0.1
      }
    }
    this.latest = tick
    this.arrived = now
  }

  at(now: number): number {
    const elapsed = Math.max(0, now - this.asked)
    this.asked = now
    const target = this.latest + (now - this.arrived) * this.rate - this.interval * 1.2 - 0.5
    const expected = this.shown + elapsed * this.rate
    const error = target - expected
    const next = Math.abs(error) > 60 ? target : expected + error * (1 - Math.exp(-elapsed / 250))
    this.shown = Math.max(this.shown, Math.min(next, this.latest + MOST_CARRIED))
    return this.shown
  }
}

interface Sample {
  tick: number
  pose: NpcPose
}

/** An NPC as it is shown. */
export interface ShownNpc {
  id: bigint
  x: number
  y: number
  z: number
  yaw: number
  state: NpcState
  /** Metres a second, as last heard. */
  speed: number
  goal: Place | undefined
  /** It was put elsewhere since the last picture. */
  snapped: boolean
}

interface Track {
  samples: Sample[]
  shown: ShownNpc
  correction: [number, number, number]
  /** The message that named the NPC last. */
  message: number
}

export interface RawPose {
  x: number
  y: number
  z: number
  yaw: number
}

const apart = (a: Place, b: Place): number => Math.hypot(a.x - b.x, a.y - b.y, a.z - b.z)

const put = (into: RawPose, x: number, y: number, z: number, yaw: number): RawPose => {
  into.x = x
  into.y = y
  into.z = z
  into.yaw = yaw
  return into
}

/** Where an NPC is at a tick that may lie between, before or after its poses. Writes into `into` and returns it. */
export function poseAt(
  samples: readonly Sample[],
  tick: number,
  into: RawPose = { x: 0, y: 0, z: 0, yaw: 0 },
): RawPose {
  let low = samples.length - 1
  while (low > 0 && samples[low]!.tick > tick) {
    low -= 1
  }
  const from = samples[low]!
  const to = samples[low + 1]
  const { position, velocity, yaw } = from.pose
  if (tick <= from.tick || (to && apart(position, to.pose.position) > SNAP_M)) {
    return put(into, position.x, position.y, position.z, yaw)
  }
  if (!to) {
    const seconds = Math.min(tick - from.tick, MOST_CARRIED) / 60
    const { x, y, z } = velocity
    return put(into, position.x + x * seconds, position.y + y * seconds, position.z + z * seconds, yaw)
  }
  const share = (tick - from.tick) / (to.tick - from.tick)
  const end = to.pose.position
  return put(
    into,
    position.x + (end.x - position.x) * share,
    position.y + (end.y - position.y) * share,
    position.z + (end.z - position.z) * share,
    yaw + shortestTurn(yaw, to.pose.yaw) * share,
  )
}

/** All NPCs of a world, from message to message. */
export class PoseBuffer {
  private readonly clock = new TickClock()
  private readonly tracks = new Map<bigint, Track>()
  private list: ShownNpc[] = []
  private tick = 0
  private message = 0
  /** Written for each NPC in each picture. */
  private readonly raw: RawPose = { x: 0, y: 0, z: 0, yaw: 0 }
  private readonly after: RawPose = { x: 0, y: 0, z: 0, yaw: 0 }

  /** Those that are shown, in a steady order. */
  get shown(): readonly ShownNpc[] {
    return this.list
  }

  find(id: bigint): ShownNpc | undefined {
    return this.tracks.get(id)?.shown
  }

  receive(tick: number, poses: readonly NpcPose[], now: number): void {
    this.clock.receive(tick, now)
    this.tick = this.clock.at(now)
    this.message += 1
    const before = this.tracks.size
    for (const pose of poses) {
      this.add(tick, pose).message = this.message
    }
    let changed = this.tracks.size !== before
    for (const [id, { message }] of this.tracks) {
      if (message !== this.message) {
        this.tracks.delete(id)
        changed = true
      }
    }
    if (changed) {
      this.list = [...this.tracks.values()].map((track) => track.shown)
    }
  }

  /** Moves everybody to where they are at `now`; tells whether anybody moved or still has a way to go. */
  advance(now: number, elapsed: number): boolean {
    this.tick = this.clock.at(now)
    const fade = Math.exp(-elapsed / FADE_MS)
    let moving = false
    for (const track of this.tracks.values()) {
      moving = this.move(track, fade) || moving
    }
    return moving
  }

  clear(): void {
    this.tracks.clear()
    this.list = []
  }

  private add(tick: number, pose: NpcPose): Track {
    const track = this.tracks.get(pose.id)
    if (!track) {
      const first: Track = { samples: [{ tick, pose }], shown: firstShown(pose), correction: [0, 0, 0], message: 0 }
      this.tracks.set(pose.id, first)
      return first
    }
    const before = poseAt(track.samples, this.tick, this.raw)
    if (track.samples.at(-1)!.tick >= tick) {
      track.samples = track.samples.filter((it) => it.tick < tick)
    }
    track.samples.push({ tick, pose })
    track.samples.splice(0, track.samples.length - KEPT_POSES)
    const after = poseAt(track.samples, this.tick, this.after)
    if (apart(before, after) < SNAP_M) {
      track.correction[0] += before.x - after.x
      track.correction[1] += before.y - after.y
      track.correction[2] += before.z - after.z
    }
    track.shown.state = pose.state
    track.shown.goal = pose.goal
    track.shown.speed = Math.hypot(pose.velocity.x, pose.velocity.y, pose.velocity.z)
    return track
  }

  private move({ samples, shown, correction }: Track, fade: number): boolean {
    const raw = poseAt(samples, this.tick, this.raw)
    for (let axis = 0; axis < 3; axis += 1) {
      correction[axis] = Math.abs(correction[axis]!) < 1e-3 ? 0 : correction[axis]! * fade
    }
    raw.x += correction[0]
    raw.y += correction[1]
    raw.z += correction[2]
    const step = apart(raw, shown)
    const turn = Math.abs(shortestTurn(shown.yaw, raw.yaw))
    shown.snapped = step > SNAP_M
    put(shown, raw.x, raw.y, raw.z, raw.yaw)
    const last = samples[samples.length - 1]!.pose
    return (
      step > 1e-4 ||
      turn > 1e-3 ||
      apart(last.position, shown) > 1e-2 ||
      Math.abs(shortestTurn(last.yaw, raw.yaw)) > 0.01
    )
  }
}

function firstShown(pose: NpcPose): ShownNpc {
  const { velocity } = pose
  return {
    id: pose.id,
    ...pose.position,
    yaw: pose.yaw,
    state: pose.state,
    speed: Math.hypot(velocity.x, velocity.y, velocity.z),
    goal: pose.goal,
    snapped: true,
  }
}
