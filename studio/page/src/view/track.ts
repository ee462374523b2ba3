// What was recorded of an NPC or a probe: a ghost on its track.

import { Group, Mesh } from 'three'
import { MARK_COLOURS, parseColour, type Rgb } from './colours'
import type { Materials } from './materials'
import { visibleScale } from './npcs'
import { LineBatch } from './overlays'
import { npcShape } from './shapes'
import type { Place, Replay } from './viewport.types'

const TICKS_A_SECOND = 60
/** Ticks between two points of the line. */
const STRIDE = 4
/** Of the line over the feet, m. */
const LIFT_M = 0.25
/** The end stays to be looked at, s. */
const REST_S = 1.5

/** Where a track is after some seconds: its position and heading; the last one when it is over. */
export function trackAt(track: ArrayLike<number>, seconds: number): { at: Place; yaw: number; tick: number } {
  const last = Math.floor(track.length / 3) - 1
  const tick = Math.min(last, Math.max(0, seconds * TICKS_A_SECOND))
  const low = Math.min(Math.floor(tick), last)
  const high = Math.min(low + 1, last)
  const share = tick - low
  const mix = (axis: number): number =>
    track[low * 3 + axis]! + (track[high * 3 + axis]! - track[low * 3 + axis]!) * share
  const ahead = Math.min(low + 6, last)
  const behind = Math.max(0, ahead - 12)
  const dx = track[ahead * 3]! - track[behind * 3]!
  const dz = track[ahead * 3 + 2]! - track[behind * 3 + 2]!
  return { at: { x: mix(0), y: mix(1), z: mix(2) }, yaw: Math.atan2(dx, dz), tick: low }
}

/** An NPC that is not there now: where it was, or where a probe went. */
class Ghost extends Group {
  private mesh: Mesh | undefined

  constructor(private readonly materials: Materials) {
    super()
  }

  show(colour: Rgb): void {
    this.hide()
    this.mesh = new Mesh(tinted(colour), this.materials.glowing)
    this.add(this.mesh)
  }

  hide(): void {
    if (this.mesh) {
      this.remove(this.mesh)
      this.mesh.geometry.dispose()
      this.mesh = undefined
    }
  }

  place({ x, y, z }: Place, yaw: number, eye: Place, scale: number): void {
    this.position.set(x, y, z)
    this.rotation.y = yaw
    this.scale.setScalar(visibleScale(1.8, 18, Math.hypot(x - eye.x, y - eye.y, z - eye.z), scale))
  }
}

/** What an NPC did, at one of its moments. */
export class ReplayView extends Group {
  private readonly line: LineBatch
  private readonly ghost: Ghost
  private shown: Replay | undefined
  /** Where the ghost is. */
  place: Place | undefined

  constructor(materials: Materials) {
    super()
    this.line = new LineBatch(materials, 'lines', 26)
    this.ghost = new Ghost(materials)
    this.add(this.line, this.ghost)
  }

  set(replay: Replay | undefined): void {
    const before = this.shown
    this.shown = replay
    if (!replay) {
      this.ghost.hide()
      this.place = undefined
    }
    if (replay?.track !== before?.track || replay?.colour !== before?.colour) {
      if (replay) {
        const colour = parseColour(replay.colour)
        this.ghost.show(colour)
        this.line.polyline(lineOf(replay.track, replay.track.length / 3), { colour, width: 3, opacity: 0.8 })
      }
      this.line.commit()
    }
  }

  update(eye: Place, scale: number): void {
    if (this.shown) {
      const { at } = trackAt(this.shown.track, this.shown.seconds)
      this.place = at
      this.ghost.place(at, this.shown.yaw, eye, scale)
    }
  }

  override dispose(): void {
    this.ghost.hide()
    this.line.dispose()
  }
}

interface Playing {
  track: Float32Array
  colour: Rgb
  started: number | undefined
  drawn: number
  done: () => void
}

export class TrackView extends Group {
  private readonly line: LineBatch
  private readonly ghost: Ghost
  private playing: Playing | undefined

  constructor(materials: Materials) {
    super()
    this.line = new LineBatch(materials, 'lines', 26)
    this.ghost = new Ghost(materials)
    this.add(this.line, this.ghost)
  }

  play(track: Float32Array, reached: boolean, done: () => void): void {
    this.stop()
    if (track.length < 3) {
      done()
      return
    }
    const colour = parseColour(reached ? MARK_COLOURS.gained : MARK_COLOURS.lost)
    this.ghost.show(colour)
    this.playing = { track, colour, started: undefined, drawn: -1, done }
  }

  /** Ends what is played, and says so. */
  stop(): void {
    const { playing } = this
    this.playing = undefined
    this.ghost.hide()
    this.line.commit()
    playing?.done()
  }

  /** Tells whether something is still played; `now` in seconds. */
  update(now: number, eye: Place, scale: number): boolean {
    const { playing } = this
    if (!playing) {
      return false
    }
    playing.started ??= now
    const seconds = now - playing.started
    const { at, yaw, tick } = trackAt(playing.track, seconds)
    this.ghost.place(at, yaw, eye, scale)
    if (tick !== playing.drawn) {
      playing.drawn = tick
      this.drawLine(playing, at, tick)
    }
    if (seconds > playing.track.length / 3 / TICKS_A_SECOND + REST_S) {
      this.stop()
    }
    return true
  }

  override dispose(): void {
    this.playing = undefined
    this.stop()
    this.line.dispose()
  }

  private drawLine({ track, colour }: Playing, at: Place, tick: number): void {
    this.line.polyline([...lineOf(track, tick), at.x, at.y + LIFT_M, at.z], { colour, width: 4 })
    this.line.commit()
  }
}

/** Points of a track up to a tick, as a line over the ground. */
function lineOf(track: Float32Array, ticks: number): number[] {
  const points: number[] = []
  for (let step = 0; step < ticks; step += STRIDE) {
    points.push(track[step * 3]!, track[step * 3 + 1]! + LIFT_M, track[step * 3 + 2]!)
  }
  return points
}

function tinted(colour: Rgb): ReturnType<typeof npcShape> {
  const shape = npcShape(true)
  const tints = shape.getAttribute('tint')
  for (let corner = 0; corner < tints.count; corner += 1) {
    if (tints.getX(corner) > 0.9) {
      tints.setXYZ(corner, ...colour)
    }
  }
  return shape
}
