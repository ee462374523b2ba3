// Batches of lines, dots and arrowheads that keep their width on the screen: one draw call each, and a faint one for
// what is hidden behind the ground.

import { BufferAttribute, BufferGeometry, Group, Mesh, type Object3D, Points, type ShaderMaterial } from 'three'
import type { Rgb } from './colours'
import type { Materials, Overlay } from './materials'
import type { Place } from './viewport.types'

export interface LineStyle {
  colour: Rgb
  /** Pixels. */
  width: number
  opacity?: number
  /** Length of a dash with its gap, m; none: a full line. */
  dash?: number
}

export const SHAPES = { disc: 0, ring: 1, cross: 2, diamond: 3 } as const

export interface SpriteStyle {
  colour: Rgb
  shape: keyof typeof SHAPES
  /** Metres across. */
  size: number
  /** Pixels across, at least and at most. */
  least: number
  most: number
  opacity?: number
}

const QUAD = { corners: [0, -1, 1, -1, 1, 1, 0, 1], indices: [0, 1, 2, 0, 2, 3] }
const HEAD = { corners: [-0.75, -0.7, 0.75, -0.7, 0, 1], indices: [0, 1, 2] }

const bytesOf = (colour: Rgb, opacity = 1): number[] => [...colour, opacity].map((part) => Math.round(part * 255))

/** Values of many copies of one flat shape; each copy's values are written once per corner. */
class Copies {
  readonly values = { iStart: [] as number[], iEnd: [] as number[], iColour: [] as number[], iStyle: [] as number[] }

  constructor(private readonly shape: { corners: number[]; indices: number[] }) {}

  get count(): number {
    return this.values.iStart.length / 3
  }

  build(): BufferGeometry {
    const { count, values } = this
    const corners = this.shape.corners.length / 2
    const geometry = new BufferGeometry()
    const corner = Float32Array.from(
      { length: count * corners * 2 },
      (_, at) => this.shape.corners[at % (corners * 2)]!,
    )
    geometry.setAttribute('corner', new BufferAttribute(corner, 2))
    geometry.setAttribute(
      'iStart',
      new BufferAttribute(repeat(values.iStart, 3, corners, new Float32Array(count * corners * 3)), 3),
    )
    geometry.setAttribute(
      'iEnd',
      new BufferAttribute(repeat(values.iEnd, 3, corners, new Float32Array(count * corners * 3)), 3),
    )
    geometry.setAttribute(
      'iColour',
      new BufferAttribute(repeat(values.iColour, 4, corners, new Uint8Array(count * corners * 4)), 4, true),
    )
    geometry.setAttribute(
      'iStyle',
      new BufferAttribute(repeat(values.iStyle, 3, corners, new Float32Array(count * corners * 3)), 3),
    )
    const { indices } = this.shape
    const index = Uint32Array.from(
      { length: count * indices.length },
      (_, at) => Math.floor(at / indices.length) * corners + indices[at % indices.length]!,
    )
    geometry.setIndex(new BufferAttribute(index, 1))
    return geometry
  }
}

function repeat<T extends Float32Array | Uint8Array>(
  values: readonly number[],
  size: number,
  times: number,
  into: T,
): T {
  for (let at = 0; at < into.length; at += 1) {
    into[at] = values[Math.floor(at / (size * times)) * size + (at % size)]!
  }
  return into
}

/** A batch that is drawn twice: what is in sight, and faintly what is behind the ground. */
abstract class Batch extends Group {
  protected readonly drawn: (Mesh | Points)[]

  constructor(materials: Overlay, make: (material: ShaderMaterial) => Mesh | Points, order: number) {
    super()
    const { behind, plain } = materials
    this.drawn = [...(behind ? [make(behind)] : []), make(plain)]
    for (const it of this.drawn) {
      const isBehind = it.material === behind
      it.frustumCulled = false
      it.renderOrder = isBehind ? order : order + 0.1
      it.userData['behind'] = isBehind
    }
    this.add(...this.drawn)
    this.visible = false
  }

  /** Shows other values. Buffers are kept where they have the right size: some batches change with every picture. */
  protected replace(geometry: BufferGeometry, count: number): void {
    const shown = this.drawn[0]!.geometry
    if (count > 0 && shown.getAttribute('iColour')?.array.length === geometry.getAttribute('iColour').array.length) {
      for (const [name, attribute] of Object.entries(geometry.attributes)) {
        const kept = shown.getAttribute(name) as BufferAttribute
        kept.array.set(attribute.array)
        kept.needsUpdate = true
      }
    } else {
      shown.dispose()
      this.drawn.forEach((it) => (it.geometry = geometry))
    }
    this.visible = count > 0
  }

  override dispose(): void {
    this.drawn[0]!.geometry.dispose()
  }
}

/** Whether what is hidden behind the ground is drawn as well, for all batches below `root`. */
export function setSeeThrough(root: Object3D, seeThrough: boolean): void {
  root.traverse((it) => {
    if (it.userData['behind'] === true) {
      it.visible = seeThrough
    }
  })
}

/** Straight pieces of lines. Gather with `line` and `polyline`, then `commit`. */
export class LineBatch extends Batch {
  private pieces = new Copies(QUAD)

  constructor(materials: Materials, look: 'lines' | 'dashes' | 'softLines' = 'lines', order = 10) {
    super(materials[look], (material) => new Mesh(new BufferGeometry(), material), order)
  }

  line(from: Place, to: Place, style: LineStyle): void {
    this.polyline([from.x, from.y, from.z, to.x, to.y, to.z], style)
  }

  polyline(points: ArrayLike<number>, style: LineStyle): void {
    let along = 0
    const colour = bytesOf(style.colour, style.opacity)
    const { iStart, iEnd, iColour, iStyle } = this.pieces.values
    for (let at = 0; at + 5 < points.length; at += 3) {
      iStart.push(points[at]!, points[at + 1]!, points[at + 2]!)
      iEnd.push(points[at + 3]!, points[at + 4]!, points[at + 5]!)
      iColour.push(...colour)
      iStyle.push(style.width, style.dash ?? 0, along)
      along += Math.hypot(
        points[at + 3]! - points[at]!,
        points[at + 4]! - points[at + 1]!,
        points[at + 5]! - points[at + 2]!,
      )
    }
  }

  commit(): void {
    this.replace(this.pieces.build(), this.pieces.count)
    this.pieces = new Copies(QUAD)
  }
}

/** Heads of arrows on lines. */
export class ArrowBatch extends Batch {
  private heads = new Copies(HEAD)

  constructor(materials: Materials, order = 11) {
    super(materials.arrows, (material) => new Mesh(new BufferGeometry(), material), order)
  }

  arrow(at: Place, towards: Place, colour: Rgb): void {
    const { iStart, iEnd, iColour, iStyle } = this.heads.values
    iStart.push(at.x, at.y, at.z)
    iEnd.push(towards.x, towards.y, towards.z)
    iColour.push(...bytesOf(colour))
    iStyle.push(0, 0, 0)
  }

  commit(): void {
    this.replace(this.heads.build(), this.heads.count)
    this.heads = new Copies(HEAD)
  }
}

/** Dots, rings and crosses that face the viewer. */
export class SpriteBatch extends Batch {
  private places: number[] = []
  private colours: number[] = []
  private styles: number[] = []

  constructor(materials: Materials, order = 12) {
    super(materials.sprites, (material) => new Points(new BufferGeometry(), material), order)
  }

  sprite(at: Place, style: SpriteStyle, lift = 0): void {
    this.places.push(at.x, at.y + lift, at.z)
    this.colours.push(...bytesOf(style.colour, style.opacity))
    this.styles.push(style.size, style.least, style.most, SHAPES[style.shape])
  }

  commit(): void {
    const geometry = new BufferGeometry()
    geometry.setAttribute('position', new BufferAttribute(Float32Array.from(this.places), 3))
    geometry.setAttribute('iColour', new BufferAttribute(Uint8Array.from(this.colours), 4, true))
    geometry.setAttribute('iStyle', new BufferAttribute(Float32Array.from(this.styles), 4))
    this.replace(geometry, this.places.length)
    this.places = []
    this.colours = []
    this.styles = []
  }
}
