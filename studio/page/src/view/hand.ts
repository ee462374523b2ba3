// What the user's gestures do to the camera, to a vertex that is dragged, and what the page hears of them.

import type { Aim } from './aim'
import type { CameraRig } from './camera-rig'
import type { Gestures, PointerPlace } from './controls'
import type { Stage } from './stage'
import type { VertexDrag } from './vertex-drag'
import type { Place, ViewportEvents } from './viewport.types'

/** Turns of the wheel within this time and so many pixels zoom to the same place. */
const ANCHOR_MS = 350
const ANCHOR_PIXELS = 12

export interface Held {
  stage: Stage
  rig: CameraRig
  aim: Aim
  vertex: VertexDrag
  events: Partial<ViewportEvents>
  stopFollowing: () => void
  /** Something that moves by itself has changed, or the camera is on its way. */
  changed: () => void
}

export class Hand implements Gestures {
  draggable = false
  private anchor: { x: number; y: number; used: number; at: Place | undefined } | undefined

  constructor(private readonly held: Held) {}

  rotate(dx: number, dy: number): void {
    const { rig, stage, events, changed } = this.held
    rig.rotate(dx, dy, stage.size.height)
    events.lookedAround?.()
    changed()
  }

  pan(dx: number, dy: number): void {
    const { rig, stage, events, stopFollowing, changed } = this.held
    rig.pan(dx, dy, stage.size.height)
    stopFollowing()
    events.lookedAround?.()
    changed()
  }

  zoom(factor: number, x: number, y: number): void {
    const { rig, events, changed } = this.held
    rig.zoom(factor, this.anchorOf(x, y))
    events.lookedAround?.()
    changed()
  }

  click(x: number, y: number, event: PointerEvent): void {
    const { aim, events } = this.held
    events.click?.(aim.pick(x, y, event.pointerType === 'touch'), event)
  }

  hover(at: PointerPlace | undefined): void {
    const { aim, stage, events } = this.held
    const hit = at && aim.pick(at.x, at.y, at.touch)
    const grabs = this.draggable && hit?.kind === 'vertex'
    stage.canvas.style.cursor = grabs ? 'move' : hit && hit.kind !== 'ground' ? 'pointer' : ''
    events.hover?.(hit)
  }

  grab({ x, y, touch }: PointerPlace): boolean {
    const hit = this.draggable ? this.held.aim.pick(x, y, touch) : undefined
    if (hit?.kind !== 'vertex') {
      return false
    }
    this.held.vertex.start(hit.index, hit.at)
    return true
  }

  drag(x: number, y: number): void {
    this.held.vertex.move(this.held.aim.ground(x, y)?.at)
    this.held.changed()
  }

  letGo(moved: boolean): void {
    const { vertex, events, changed } = this.held
    const dropped = vertex.end()
    if (moved && dropped) {
      events.vertexDragged?.(dropped.index, dropped.to)
    }
    changed()
  }

  turns(): boolean {
    return !this.held.rig.top
  }

  wake(): void {
    this.held.changed()
  }

  /** What is zoomed to. It stays the same from notch to notch, since the picture lags behind the wheel. */
  private anchorOf(x: number, y: number): Place | undefined {
    const now = performance.now()
    const { anchor } = this
    const same = anchor && now - anchor.used < ANCHOR_MS && Math.hypot(x - anchor.x, y - anchor.y) < ANCHOR_PIXELS
    this.anchor = same ? { ...anchor, used: now } : { x, y, used: now, at: this.held.aim.ground(x, y)?.at }
    return this.anchor.at
  }
}
