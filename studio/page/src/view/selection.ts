// The selected NPC: a ring at its feet, what is left of its plan, its goal, and what its eyes see.

import { Group, Mesh } from 'three'
import { abilityColour, MARK_COLOURS, parseColour, SURFACE_COLOURS } from './colours'
import { arc, LIFT_M } from './edge-shape'
import type { Materials } from './materials'
import { visibleScale } from './npcs'
import { LineBatch, SpriteBatch } from './overlays'
import type { ShownNpc } from './poses'
import { flagShape, ringShape } from './shapes'
import type { Place, SelectedNpc } from './viewport.types'

const lifted = (place: Place): Place => ({ ...place, y: place.y + LIFT_M })

export class SelectionView extends Group {
  selected: SelectedNpc | undefined
  private shown = false
  private readonly ring: Mesh
  private readonly flag: Mesh
  private readonly plan: LineBatch
  private readonly current: LineBatch
  private readonly rays: LineBatch
  private readonly dots: SpriteBatch

  constructor(materials: Materials) {
    super()
    this.ring = new Mesh(ringShape([1, 1, 1], 0.85, 0.08), materials.glowing)
    this.flag = new Mesh(flagShape(parseColour(MARK_COLOURS.goal)), materials.glowing)
    this.ring.visible = false
    this.flag.visible = false
    this.rays = new LineBatch(materials, 'softLines', 7)
    this.plan = new LineBatch(materials, 'lines', 23)
    this.current = new LineBatch(materials, 'lines', 24)
    this.dots = new SpriteBatch(materials, 25)
    this.add(this.ring, this.flag, this.rays, this.plan, this.current, this.dots)
  }

  set(selected: SelectedNpc | undefined): void {
    this.selected = selected
    if (selected) {
      this.addPlan(selected)
      this.addRays(selected)
    }
    this.rays.commit()
    this.plan.commit()
    this.dots.commit()
  }

  /** Follows the NPC from picture to picture. */
  update(npc: ShownNpc | undefined, eye: Place, scale: number): void {
    if (!this.selected && !this.shown) {
      return
    }
    this.shown = this.selected !== undefined
    this.ring.visible = npc !== undefined && this.shown
    const goal = this.selected && (npc?.goal ?? this.selected.waypoints.at(-1))
    this.flag.visible = goal !== undefined
    const sizeAt = ({ x, y, z }: Place): number =>
      visibleScale(1.8, 15, Math.hypot(x - eye.x, y - eye.y, z - eye.z), scale)
    if (npc) {
      this.ring.position.set(npc.x, npc.y + 0.12, npc.z)
      this.ring.scale.setScalar(sizeAt(npc))
    }
    if (goal) {
      this.flag.position.set(goal.x, goal.y, goal.z)
      this.flag.scale.setScalar(sizeAt(goal))
    }
    this.updateCurrent(npc)
  }

  override dispose(): void {
    this.ring.geometry.dispose()
    this.flag.geometry.dispose()
    for (const batch of [this.plan, this.current, this.rays, this.dots]) {
      batch.dispose()
    }
  }

  /** The leg that the NPC is on starts where it is now. */
  private updateCurrent(npc: ShownNpc | undefined): void {
    const { selected } = this
    const to = selected?.waypoints[selected.heading]
    if (npc && to) {
      const colour = abilityColour(selected.abilities[selected.heading] ?? 0)
      const points = arc(npc, to, 1, 'straight')
      this.current.polyline(points, { colour: [1, 1, 1], width: 7, opacity: 0.9 })
      this.current.polyline(points, { colour, width: 4 })
    }
    this.current.commit()
  }

  private addPlan({ waypoints, abilities, heading }: SelectedNpc): void {
    for (let at = heading; at < waypoints.length; at += 1) {
      const to = waypoints[at]!
      const colour = abilityColour(abilities[at] ?? 0)
      const current = at === heading
      if (!current) {
        this.plan.polyline(arc(waypoints[at - 1]!, to, abilities[at] ?? 0, 'smooth'), { colour, width: 3.5 })
      }
      this.dots.sprite(lifted(to), {
        colour,
        shape: 'disc',
        size: 0.6,
        least: current ? 10 : 7,
        most: current ? 16 : 12,
      })
      if (current) {
        this.dots.sprite(lifted(to), { colour: [1, 1, 1], shape: 'ring', size: 1.3, least: 17, most: 28 })
      }
    }
  }

  private addRays({ eyes, rays }: SelectedNpc): void {
    if (!eyes) {
      return
    }
    for (const { end, surface } of rays) {
      const colour = parseColour(SURFACE_COLOURS[surface] ?? SURFACE_COLOURS[0])
      this.rays.line(eyes, end, { colour, width: 1.3, opacity: surface === 0 ? 0.1 : 0.4 })
      if (surface !== 0) {
        this.dots.sprite(end, { colour, shape: 'disc', size: 0.18, least: 3, most: 6 })
      }
    }
  }
}
