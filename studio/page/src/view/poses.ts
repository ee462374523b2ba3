// Smooth motion from poses that arrive a few times a second: NPCs are shown about one message late, so that there is
// mostly a pose on either side to go between. No renderer here.

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
}

export interface RawPose {
  x: number
  y: number
  z: number
  yaw: number
}

const shortestTurn = (from: number, to: number): number => {
  const turn = (to - from) % (2 * Math.PI)
  return turn > Math.PI ? turn - 2 * Math.PI : turn < -Math.PI ? turn + 2 * Math.PI : turn
}

const apart = (a: Place, b: Place): number => Math.hypot(a.x - b.x, a.y - b.y, a.z - b.z)

/** Where an NPC is at a tick that may lie between, before or after its poses. */
export function poseAt(samples: readonly Sample[], tick: number): RawPose {
  let low = samples.length - 1
  while (low > 0 && samples[low]!.tick > tick) {
    low -= 1
  }
  const from = samples[low]!
  const to = samples[low + 1]
  const { position, velocity, yaw } = from.pose
  if (tick <= from.tick || (to && apart(position, to.pose.position) > SNAP_M)) {
    return { x: position.x, y: position.y, z: position.z, yaw }
  }
  if (!to) {
    const seconds = Math.min(tick - from.tick, MOST_CARRIED) / 60
    return {
      x: position.x + velocity.x * seconds,
      y: position.y + velocity.y * seconds,
      z: position.z + velocity.z * seconds,
      yaw,
    }
  }
  const share = (tick - from.tick) / (to.tick - from.tick)
  const end = to.pose.position
  return {
    x: position.x + (end.x - position.x) * share,
    y: position.y + (end.y - position.y) * share,
    z: position.z + (end.z - position.z) * share,
    yaw: yaw + shortestTurn(yaw, to.pose.yaw) * share,
  }
}

/** All NPCs of a world, from message to message. */
export class PoseBuffer {
  private readonly clock = new TickClock()
  private readonly tracks = new Map<bigint, Track>()
  private list: ShownNpc[] = []
  private tick = 0

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
    const present = new Set<bigint>()
    for (const pose of poses) {
      present.add(pose.id)
      this.add(tick, pose)
    }
    for (const id of this.tracks.keys()) {
      if (!present.has(id)) {
        this.tracks.delete(id)
      }
    }
    this.list = [...this.tracks.values()].map((track) => track.shown)
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

  private add(tick: number, pose: NpcPose): void {
    const track = this.tracks.get(pose.id)
    if (!track) {
      this.tracks.set(pose.id, { samples: [{ tick, pose }], shown: firstShown(pose), correction: [0, 0, 0] })
      return
    }
    const before = poseAt(track.samples, this.tick)
    if (track.samples.at(-1)!.tick >= tick) {
      track.samples = track.samples.filter((it) => it.tick < tick)
    }
    track.samples.push({ tick, pose })
    track.samples.splice(0, track.samples.length - KEPT_POSES)
    const after = poseAt(track.samples, this.tick)
    if (apart(before, after) < SNAP_M) {
      track.correction[0] += before.x - after.x
      track.correction[1] += before.y - after.y
      track.correction[2] += before.z - after.z
    }
    track.shown.state = pose.state
    track.shown.goal = pose.goal
    track.shown.speed = Math.hypot(pose.velocity.x, pose.velocity.y, pose.velocity.z)
  }

  private move({ samples, shown, correction }: Track, fade: number): boolean {
    const raw = poseAt(samples, this.tick)
    for (let axis = 0; axis < 3; axis += 1) {
      correction[axis] = Math.abs(correction[axis]!) < 1e-3 ? 0 : correction[axis]! * fade
    }
    const next = { x: raw.x + correction[0], y: raw.y + correction[1], z: raw.z + correction[2] }
    const step = apart(next, shown)
    const turn = Math.abs(shortestTurn(shown.yaw, raw.yaw))
    shown.snapped = step > SNAP_M
    shown.x = next.x
    shown.y = next.y
    shown.z = next.z
    shown.yaw = raw.yaw
    const last = samples.at(-1)!.pose
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
