// Names over the map: drawn by the browser into a canvas of their own, so that they stay sharp while the picture is coarse.

import { chooseLabels, type PlacedLabel } from './label-layout'
import type { Projector } from './picking'
import type { Label, LabelGroup, Place, Theme } from './viewport.types'

/** Labels shown at once. */
const MOST = 22
/** Which labels are shown is decided this often, ms. */
const CHOOSE_MS = 220
/** Texts that are kept drawn. */
const KEPT_TEXTS = 400

const FONT = '600 11.5px system-ui, -apple-system, "Segoe UI", "Noto Sans", Arial, sans-serif'
const HEIGHT = 20
const PADDING = 7
const DOT = 11
/** From the named place up to the label, pixels. */
const STEM = 9

const INKS = {
  dark: {
    plate: 'rgb(17 21 27 / 82%)',
    text: '#f0f3f8',
    stem: 'rgb(240 243 248 / 70%)',
    line: 'rgb(255 255 255 / 16%)',
  },
  light: { plate: 'rgb(253 254 255 / 88%)', text: '#17202c', stem: 'rgb(23 32 44 / 60%)', line: 'rgb(20 32 50 / 16%)' },
}

export interface LabelSight {
  now: number
  projector: Projector
  width: number
  height: number
  /** Pixels of the screen per pixel of the page. */
  ratio: number
  /** What the camera looks at. */
  centre: Place
  /** Names farther than this from it are not shown, m. */
  reach: number
  /** What is above is not shown. */
  ceiling: number
  /** Where an NPC is shown. */
  npc(id: bigint): Place | undefined
  /** Whether rock is between the eye and a place. */
  isHidden(place: Place): boolean
}

interface Plate {
  image: HTMLCanvasElement
  width: number
}

interface ShownLabel {
  label: Label
  plate: Plate
}

export class LabelLayer {
  readonly canvas = document.createElement('canvas')
  private readonly brush = this.canvas.getContext('2d')
  private readonly groups = new Map<LabelGroup, readonly Label[]>()
  private readonly plates = new Map<string, Plate>()
  private shown = new Map<string, ShownLabel>()
  private chosenAt = -Infinity
  private inks = INKS.dark
  private ratio = 1
  private visible = true

  constructor(container: HTMLElement) {
    this.canvas.style.cssText = 'position:absolute;inset:0;width:100%;height:100%;pointer-events:none'
    this.canvas.setAttribute('aria-hidden', 'true')
    container.append(this.canvas)
  }

  set(group: LabelGroup, labels: readonly Label[]): void {
    this.groups.set(group, labels)
    this.chosenAt = -Infinity
  }

  clear(): void {
    this.groups.clear()
    this.chosenAt = -Infinity
  }

  setVisible(visible: boolean): void {
    this.visible = visible
  }

  setTheme({ dark }: Theme): void {
    this.inks = dark ? INKS.dark : INKS.light
    this.plates.clear()
    this.chosenAt = -Infinity
  }

  draw(sight: LabelSight): void {
    const { brush } = this
    if (!brush) {
      return
    }
    this.fit(sight)
    brush.clearRect(0, 0, this.canvas.width, this.canvas.height)
    if (!this.visible) {
      return
    }
    if (sight.now - this.chosenAt >= CHOOSE_MS) {
      this.chosenAt = sight.now
      this.choose(sight)
    }
    for (const { label, plate } of this.shown.values()) {
      const placed = this.place(label, plate, sight)
      if (placed) {
        this.paint(placed, plate)
      }
    }
  }

  dispose(): void {
    this.canvas.remove()
  }

  private fit({ width, height, ratio }: LabelSight): void {
    const [wide, high] = [Math.round(width * ratio), Math.round(height * ratio)]
    if (this.canvas.width !== wide || this.canvas.height !== high || this.ratio !== ratio) {
      this.canvas.width = wide
      this.canvas.height = high
      this.ratio = ratio
      this.plates.clear()
      this.chosenAt = -Infinity
    }
  }

  private choose(sight: LabelSight): void {
    const candidates = new Map<string, ShownLabel & { at: Place }>()
    const placed: PlacedLabel[] = []
    for (const [group, labels] of this.groups) {
      labels.forEach((label, index) => {
        const at = placeOf(label, sight)
        const { centre, reach } = sight
        const isNear = at && Math.hypot(at.x - centre.x, at.y - centre.y, at.z - centre.z) <= reach
        if (!at || at.y > sight.ceiling || !(isNear || label.rank === 0)) {
          return
        }
        const plate = this.plateOf(label)
        const box = this.place(label, plate, sight)
        if (box && isWhole(box, sight)) {
          const key = `${group} ${index} ${label.text}`
          candidates.set(key, { label, plate, at })
          placed.push({ ...box, key })
        }
      })
    }
    const isSeen = ({ key, rank }: PlacedLabel): boolean => rank === 0 || !sight.isHidden(candidates.get(key)!.at)
    const chosen = chooseLabels(placed, new Set(this.shown.keys()), MOST, isSeen)
    // The nearest last, so that they are on top once the camera moves.
    chosen.sort((a, b) => b.depth - a.depth)
    this.shown = new Map(chosen.map(({ key }) => [key, candidates.get(key)!]))
  }

  /** Where a label stands in the picture; undefined: outside of it. */
  private place(label: Label, plate: Plate, sight: LabelSight): PlacedLabel | undefined {
    const at = placeOf(label, sight)
    const seen = at && sight.projector.project(at.x, at.y, at.z)
    if (!seen || seen.x < 0 || seen.y < 0 || seen.x > sight.width || seen.y > sight.height) {
      return undefined
    }
    const { width } = plate
    const [left, top] = [seen.x - width / 2, seen.y - STEM - HEIGHT]
    return { key: '', rank: label.rank, depth: seen.depth, left, top, width, height: HEIGHT }
  }

  private paint({ left, top, width }: PlacedLabel, { image }: Plate): void {
    const { ratio } = this
    const brush = this.brush!
    const middle = Math.round((left + width / 2) * ratio)
    brush.fillStyle = this.inks.stem
    brush.fillRect(middle, Math.round((top + HEIGHT) * ratio), Math.max(1, Math.round(ratio)), Math.round(STEM * ratio))
    brush.drawImage(image, Math.round(left * ratio), Math.round(top * ratio))
  }

  /** A text on its plate, drawn once. */
  private plateOf({ text, colour }: Label): Plate {
    const key = `${text} ${colour}`
    const kept = this.plates.get(key)
    if (kept) {
      return kept
    }
    if (this.plates.size >= KEPT_TEXTS) {
      this.plates.clear()
    }
    const plate = this.drawPlate(text, colour)
    this.plates.set(key, plate)
    return plate
  }

  private drawPlate(text: string, colour: string | undefined): Plate {
    const { ratio, inks } = this
    const image = document.createElement('canvas')
    const brush = image.getContext('2d')!
    brush.font = FONT
    const dot = colour === undefined ? 0 : DOT
    const width = Math.ceil(brush.measureText(text).width) + 2 * PADDING + dot
    image.width = Math.ceil(width * ratio)
    image.height = Math.ceil(HEIGHT * ratio)
    brush.scale(ratio, ratio)
    brush.beginPath()
    brush.roundRect(0.5, 0.5, width - 1, HEIGHT - 1, 6)
    brush.fillStyle = inks.plate
    brush.fill()
    brush.strokeStyle = inks.line
    brush.stroke()
    if (colour !== undefined) {
      brush.beginPath()
      brush.arc(PADDING + 3.5, HEIGHT / 2, 3.5, 0, 2 * Math.PI)
      brush.fillStyle = colour
      brush.fill()
    }
    brush.font = FONT
    brush.textBaseline = 'middle'
    brush.fillStyle = inks.text
    brush.fillText(text, PADDING + dot, HEIGHT / 2 + 0.5)
    return { image, width }
  }
}

function isWhole({ left, top, width }: PlacedLabel, sight: LabelSight): boolean {
  return left >= 0 && top >= 0 && left + width <= sight.width
}

function placeOf({ at, npc }: Label, sight: LabelSight): Place | undefined {
  const shown = npc && sight.npc(npc.id)
  return npc === undefined ? at : shown && { x: shown.x, y: shown.y + npc.lift, z: shown.z }
}
