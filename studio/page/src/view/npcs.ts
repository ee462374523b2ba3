// NPCs as capsules with a nose: one draw call for all, one more for those behind the ground.

import { BufferAttribute, BufferGeometry, DataTexture, FloatType, Group, Mesh, RGBAFormat } from 'three'
import { parseColour, type Rgb, STATE_COLOURS } from './colours'
import { type Materials, STATES } from './materials'
import type { ShownNpc } from './poses'
import { npcShape } from './shapes'
import type { Place } from './viewport.types'

/** NPCs are drawn at least so high, pixels; those far away are drawn larger than they are. */
const LEAST_PIXELS = 13
const HEIGHT_M = 1.8
const WIDTH_M = 1
const MOST_SCALE = 14
/** From this height on, pixels, an NPC is drawn round. */
const FINE_PIXELS = 44
const COLOURS = {
  idle: parseColour(STATE_COLOURS.idle),
  seeking: parseColour(STATE_COLOURS.seeking),
  down: parseColour(STATE_COLOURS.down),
}

export function npcColour(npc: ShownNpc): Rgb {
  return COLOURS[npc.state]
}

/** How much larger than life something is drawn so that it keeps so many pixels. */
export function visibleScale(
  metres: number,
  leastPixels: number,
  distance: number,
  pixelsPerMetreAtOne: number,
): number {
  return Math.min(MOST_SCALE, Math.max(1, (leastPixels * distance) / (pixelsPerMetreAtOne * metres)))
}

export interface Sight {
  eye: Place
  /** Height in pixels of one metre at a distance of one metre. */
  scale: number
  /** From the vertical: from above an NPC looks smaller. */
  polar: number
  /** What is above is hidden. */
  ceiling: number
  selected: bigint | undefined
}

/** Two texels for each NPC: place and size; sine and cosine of its heading, whether it lies, its state. */
const TEXELS = 2

export class NpcView extends Group {
  private room = 0
  private fine = false
  private tallest = 0
  private poses = new DataTexture()
  private readonly plain: Mesh
  private readonly hidden: Mesh

  constructor(private readonly materials: Materials) {
    super()
    this.hidden = new Mesh(new BufferGeometry(), materials.hiddenNpcs)
    this.plain = new Mesh(this.hidden.geometry, materials.npcs)
    this.hidden.userData['behind'] = true
    // Those behind the ground first: an NPC does not hide itself.
    for (const [order, mesh] of [this.hidden, this.plain].entries()) {
      mesh.frustumCulled = false
      mesh.renderOrder = order
      this.add(mesh)
    }
    this.grow(16)
  }

  update(npcs: readonly ShownNpc[], sight: Sight): void {
    if (npcs.length > this.room) {
      this.grow(npcs.length)
    }
    let count = 0
    this.tallest = 0
    const tall = WIDTH_M + (HEIGHT_M - WIDTH_M) * Math.sin(sight.polar)
    for (const npc of npcs) {
      if (npc.y <= sight.ceiling || npc.id === sight.selected) {
        this.place(count, npc, tall, sight)
        count += 1
      }
    }
    if (this.fine !== this.tallest > FINE_PIXELS) {
      this.fine = !this.fine
      this.reshape()
    }
    const { geometry } = this.plain
    geometry.setDrawRange(0, count * (geometry.getIndex()!.count / this.room))
    this.visible = count > 0
    this.poses.needsUpdate = true
  }

  override dispose(): void {
    this.plain.geometry.dispose()
    this.poses.dispose()
  }

  private place(at: number, npc: ShownNpc, tall: number, { eye, scale }: Sight): void {
    const distance = Math.hypot(npc.x - eye.x, npc.y - eye.y, npc.z - eye.z)
    const size = visibleScale(tall, LEAST_PIXELS, distance, scale)
    this.tallest = Math.max(this.tallest, (HEIGHT_M * scale) / distance)
    const values = this.poses.image.data as Float32Array
    const first = at * TEXELS * 4
    values[first] = npc.x
    values[first + 1] = npc.y
    values[first + 2] = npc.z
    values[first + 3] = size
    values[first + 4] = Math.sin(npc.yaw)
    values[first + 5] = Math.cos(npc.yaw)
    values[first + 6] = npc.state === 'down' ? 1 : 0
    values[first + 7] = STATES.indexOf(npc.state)
  }

  private grow(count: number): void {
    this.room = 2 ** Math.ceil(Math.log2(Math.max(count, 1)))
    this.reshape()
    this.poses.dispose()
    this.poses = new DataTexture(new Float32Array(this.room * TEXELS * 4), TEXELS, this.room, RGBAFormat, FloatType)
    this.materials.uniforms.uPoses.value = this.poses
  }

  private reshape(): void {
    this.plain.geometry.dispose()
    this.plain.geometry = copies(npcShape(this.fine), this.room)
    this.hidden.geometry = this.plain.geometry
  }
}

/** The same shape many times over; each corner knows whose it is. */
function copies(shape: BufferGeometry, count: number): BufferGeometry {
  const geometry = new BufferGeometry()
  const corners = shape.getAttribute('position').count
  for (const name of ['position', 'normal', 'tint']) {
    const one = shape.getAttribute(name).array as Float32Array
    const all = new Float32Array(one.length * count)
    for (let at = 0; at < count; at += 1) {
      all.set(one, at * one.length)
    }
    geometry.setAttribute(name, new BufferAttribute(all, 3))
  }
  const who = Float32Array.from({ length: corners * count }, (_, at) => Math.floor(at / corners))
  geometry.setAttribute('who', new BufferAttribute(who, 1))
  const index = shape.getIndex()!.array
  const size = index.length
  const indices = Uint32Array.from(
    { length: size * count },
    (_, at) => index[at % size]! + Math.floor(at / size) * corners,
  )
  geometry.setIndex(new BufferAttribute(indices, 1))
  shape.dispose()
  return geometry
}
