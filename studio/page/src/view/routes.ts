// Ways through the map: paths that were asked for, what a designer changed, and what that did.

import { Group, Mesh } from 'three'
import { abilityColour, MARK_COLOURS, parseColour, type Rgb } from './colours'
import { arc, LIFT_M, pointAlong } from './edge-shape'
import type { Materials } from './materials'
import { visibleScale } from './npcs'
import { ArrowBatch, LineBatch, SpriteBatch } from './overlays'
import { pinShape } from './shapes'
import type { EditMark, PathLine, Place } from './viewport.types'

const lifted = (place: Place): Place => ({ ...place, y: place.y + LIFT_M })
const PIN_M = 2.6
const PIN_PIXELS = 34

/** Alternatives thin and grey, the chosen one bold by ability. */
export class PathView extends Group {
  private readonly lines: LineBatch
  private readonly arrows: ArrowBatch
  private readonly dots: SpriteBatch

  constructor(materials: Materials) {
    super()
    this.lines = new LineBatch(materials, 'lines', 20)
    this.arrows = new ArrowBatch(materials, 21)
    this.dots = new SpriteBatch(materials, 22)
    this.add(this.lines, this.arrows, this.dots)
  }

  set(paths: readonly PathLine[]): void {
    // The chosen one last, so that it lies on top.
    for (const path of [...paths].sort((a, b) => Number(a.chosen) - Number(b.chosen))) {
      this.addPath(path)
    }
    this.lines.commit()
    this.arrows.commit()
    this.dots.commit()
  }

  override dispose(): void {
    this.lines.dispose()
    this.arrows.dispose()
    this.dots.dispose()
  }

  private addPath({ start, waypoints, abilities, chosen }: PathLine): void {
    let from = start
    for (const [at, to] of waypoints.entries()) {
      const colour: Rgb = chosen ? abilityColour(abilities[at] ?? 0) : parseColour(MARK_COLOURS.alternative)
      const points = arc(from, to, abilities[at] ?? 0, 'smooth')
      this.lines.polyline(points, { colour, width: chosen ? 5 : 2, opacity: chosen ? 1 : 0.75 })
      if (chosen) {
        const { at: place, towards } = pointAlong(points, 0.6)
        this.arrows.arrow(place, towards, [1, 1, 1])
        this.dots.sprite(lifted(to), { colour, shape: 'disc', size: 0.7, least: 7, most: 14 })
      }
      from = to
    }
  }
}

/** Pins at the ends of a query. */
export class MarkerView extends Group {
  private readonly pins: Record<'start' | 'goal' | 'nearest', Mesh>

  constructor(materials: Materials) {
    super()
    const pin = (colour: string): Mesh => new Mesh(pinShape(parseColour(colour)), materials.glowing)
    this.pins = { start: pin(MARK_COLOURS.start), goal: pin(MARK_COLOURS.goal), nearest: pin(MARK_COLOURS.nearest) }
    for (const mesh of Object.values(this.pins)) {
      mesh.visible = false
      this.add(mesh)
    }
  }

  set(places: Record<'start' | 'goal' | 'nearest', Place | undefined>): void {
    for (const name of ['start', 'goal', 'nearest'] as const) {
      const place = places[name]
      this.pins[name].visible = place !== undefined
      if (place) {
        this.pins[name].position.set(place.x, place.y, place.z)
      }
    }
  }

  /** Keeps the pins large enough to be seen. */
  scaleFor(eye: Place, scale: number): void {
    for (const pin of Object.values(this.pins)) {
      const { x, y, z } = pin.position
      pin.scale.setScalar(visibleScale(PIN_M, PIN_PIXELS, Math.hypot(x - eye.x, y - eye.y, z - eye.z), scale))
    }
  }

  override dispose(): void {
    Object.values(this.pins).forEach((pin) => pin.geometry.dispose())
  }
}

/** Forbidden edges, removed vertices, and places that were lost or gained by a change. */
export class MarkView extends Group {
  private readonly dashes: LineBatch
  private readonly crosses: SpriteBatch
  private readonly places: SpriteBatch

  constructor(materials: Materials) {
    super()
    this.dashes = new LineBatch(materials, 'dashes', 16)
    this.crosses = new SpriteBatch(materials, 17)
    this.places = new SpriteBatch(materials, 9)
    this.add(this.dashes, this.crosses, this.places)
  }

  setEdits(marks: readonly EditMark[]): void {
    const colour = parseColour(MARK_COLOURS.forbidden)
    for (const { kind, from, to } of marks) {
      if (kind === 'forbidden' && to) {
        const points = arc(from, to, 1, 'straight')
        this.dashes.polyline(points, { colour, width: 3, dash: 1.4 })
        this.crosses.sprite(pointAlong(points, 0.5).at, { colour, shape: 'cross', size: 1.1, least: 15, most: 26 })
      } else {
        this.crosses.sprite(lifted(from), { colour, shape: 'cross', size: 1.3, least: 17, most: 30 })
      }
    }
    this.dashes.commit()
    this.crosses.commit()
  }

  setDifference(lost: readonly Place[], gained: readonly Place[]): void {
    for (const [places, colour] of [
      [lost, MARK_COLOURS.lost],
      [gained, MARK_COLOURS.gained],
    ] as const) {
      for (const place of places) {
        this.places.sprite(lifted(place), { colour: parseColour(colour), shape: 'disc', size: 0.9, least: 6, most: 16 })
      }
    }
    this.places.commit()
  }

  override dispose(): void {
    this.dashes.dispose()
    this.crosses.dispose()
    this.places.dispose()
  }
}
