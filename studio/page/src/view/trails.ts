// Where NPCs were in the last seconds: a ring of slots, each with a piece of way per NPC: a step writes one slot.

import { BufferAttribute, BufferGeometry, DynamicDrawUsage, LineSegments } from 'three'
import type { Rgb } from './colours'
import type { Materials } from './materials'
import { npcColour } from './npcs'
import type { ShownNpc } from './poses'

const LASTING_S = 5
const STEP_S = 0.1
const SLOTS = Math.round(LASTING_S / STEP_S)
/** Over the feet, m. */
const LIFT_M = 0.25

type Point = [x: number, y: number, z: number]

export class Trails {
  readonly lines: LineSegments<BufferGeometry>
  private room = 0
  private slot = 0
  private next = 0
  private readonly last = new Map<bigint, Point>()

  constructor(private readonly materials: Materials) {
    this.lines = new LineSegments(new BufferGeometry(), materials.trails)
    this.lines.frustumCulled = false
    this.lines.renderOrder = 3
    materials.uniforms.uLasting.value = LASTING_S
    this.grow(1)
  }

  /** Takes in where everybody is; `now` in seconds. */
  update(npcs: readonly ShownNpc[], now: number): void {
    this.materials.uniforms.uNow.value = now
    for (const npc of npcs) {
      if (npc.snapped) {
        this.last.delete(npc.id)
      }
    }
    if (now < this.next) {
      return
    }
    this.next = now + STEP_S
    if (npcs.length > this.room) {
      this.grow(npcs.length)
    }
    this.write(npcs, now)
    this.slot = (this.slot + 1) % SLOTS
  }

  clear(): void {
    this.last.clear()
    if (this.room > 0) {
      this.grow(this.room)
    }
  }

  dispose(): void {
    this.lines.geometry.dispose()
  }

  private write(npcs: readonly ShownNpc[], now: number): void {
    const first = this.slot * this.room * 2
    const { position, tint, born } = this.attributes()
    const ages = born.array as Float32Array
    ages.fill(-1, first, first + this.room * 2)
    npcs.forEach((npc, at) => {
      const before = this.last.get(npc.id)
      const y = npc.y + LIFT_M
      if (!before) {
        this.last.set(npc.id, [npc.x, y, npc.z])
        return
      }
      if (Math.hypot(npc.x - before[0], y - before[1], npc.z - before[2]) > 0.02) {
        const corner = first + at * 2
        const colour: Rgb = npcColour(npc)
        position.array.set(before, corner * 3)
        tint.array.set(colour, corner * 3)
        ages[corner] = now - STEP_S
        before[0] = npc.x
        before[1] = y
        before[2] = npc.z
        position.array.set(before, corner * 3 + 3)
        tint.array.set(colour, corner * 3 + 3)
        ages[corner + 1] = now
      }
    })
    for (const attribute of [position, tint, born]) {
      attribute.addUpdateRange(first * attribute.itemSize, this.room * 2 * attribute.itemSize)
      attribute.needsUpdate = true
    }
  }

  private attributes(): Record<'position' | 'tint' | 'born', BufferAttribute> {
    const { geometry } = this.lines
    return {
      position: geometry.getAttribute('position') as BufferAttribute,
      tint: geometry.getAttribute('tint') as BufferAttribute,
      born: geometry.getAttribute('born') as BufferAttribute,
    }
  }

  private grow(count: number): void {
    this.room = Math.max(this.room, 2 ** Math.ceil(Math.log2(Math.max(16, count))))
    const corners = this.room * 2 * SLOTS
    const geometry = new BufferGeometry()
    for (const [name, size] of [
      ['position', 3],
      ['tint', 3],
      ['born', 1],
    ] as const) {
      const values = new Float32Array(corners * size)
      geometry.setAttribute(
        name,
        new BufferAttribute(size === 1 ? values.fill(-1) : values, size).setUsage(DynamicDrawUsage),
      )
    }
    this.lines.geometry.dispose()
    this.lines.geometry = geometry
    this.slot = 0
  }
}
