// A probe that is played back: a ghost runs along its way at real speed and leaves a line.

import { Group, Mesh } from 'three'
import { MARK_COLOURS, parseColour, type Rgb } from './colours'
import type { Materials } from './materials'
import { visibleScale } from './npcs'
import { LineBatch } from './overlays'
import { npcShape } from './shapes'
import type { Place } from './viewport.types'

const TICKS_A_SECOND = 60
/** Ticks between two points of the line. */
const STRIDE = 4
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

interface Playing {
  track: Float32Array
  colour: Rgb
  started: number | undefined
  drawn: number
  done: () => void
}

export class TrackView extends Group {
  private readonly line: LineBatch
  private ghost: Mesh | undefined
  private playing: Playing | undefined

  constructor(private readonly materials: Materials) {
    super()
    this.line = new LineBatch(materials, false, 26)
    this.add(this.line)
  }

  play(track: Float32Array, reached: boolean, done: () => void): void {
    this.stop()
    if (track.length < 3) {
      done()
      return
    }
    const colour = parseColour(reached ? MARK_COLOURS.gained : MARK_COLOURS.lost)
    this.ghost = new Mesh(tinted(colour), this.materials.glowing)
    this.add(this.ghost)
    this.playing = { track, colour, started: undefined, drawn: -1, done }
  }

  /** Ends what is played, and says so. */
  stop(): void {
    const { playing, ghost } = this
    this.playing = undefined
    if (ghost) {
      this.remove(ghost)
      ghost.geometry.dispose()
      this.ghost = undefined
    }
    this.line.commit()
    playing?.done()
  }

  /** Tells whether something is still played; `now` in seconds. */
  update(now: number, eye: Place, scale: number): boolean {
    const { playing, ghost } = this
    if (!playing || !ghost) {
      return false
    }
    playing.started ??= now
    const seconds = now - playing.started
    const { at, yaw, tick } = trackAt(playing.track, seconds)
    ghost.position.set(at.x, at.y, at.z)
    ghost.rotation.y = yaw
    ghost.scale.setScalar(visibleScale(1.8, 18, Math.hypot(at.x - eye.x, at.y - eye.y, at.z - eye.z), scale))
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
    const points: number[] = []
    for (let step = 0; step < tick; step += STRIDE) {
      points.push(track[step * 3]!, track[step * 3 + 1]! + 0.25, track[step * 3 + 2]!)
    }
    points.push(at.x, at.y + 0.25, at.z)
    this.line.polyline(points, { colour, width: 4 })
    this.line.commit()
  }
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
