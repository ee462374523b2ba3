// What lies under the pointer: gathers what can be picked and asks which of it is meant.

import type { CameraRig } from './camera-rig'
import { LIFT_M } from './edge-shape'
import { type GraphView, VERTEX_M } from './graph-view'
import type { GroundHit } from './ground'
import {
  type Candidate,
  chooseHit,
  MOUSE_REACH,
  pickPoint,
  type PickPoint,
  type Pointer,
  ProjectedLines,
  Projector,
  TOUCH_REACH,
} from './picking'
import type { MoverView } from './movers'
import type { PoseBuffer } from './poses'
import type { Stage } from './stage'
import type { Terrain } from './terrain'
import type { Hit } from './viewport.types'

export interface Aimed {
  stage: Stage
  rig: CameraRig
  terrain: Terrain
  graph: GraphView
  movers: MoverView
  poses: PoseBuffer
}

export class Aim {
  private lines: ProjectedLines | undefined
  private readonly matrix = new Float64Array(16)
  section: number | undefined
  /** Undefined: everything can be picked. */
  pickable: ReadonlySet<Hit['kind']> | undefined

  constructor(private readonly scene: Aimed) {}

  /** The camera or the graph has changed. */
  invalidate(): void {
    this.lines = undefined
  }

  ground(x: number, y: number): GroundHit | undefined {
    return this.groundWithDepth(x, y).ground
  }

  pick(x: number, y: number, touch: boolean): Hit | undefined {
    const { ground, depth } = this.groundWithDepth(x, y)
    const pointer = { x, y, reach: touch ? TOUCH_REACH : MOUSE_REACH }
    const projector = this.projector()
    const candidates = [
      ...this.npcs(pointer, projector),
      ...this.vertices(pointer, projector),
      ...pickPoint(this.scene.movers.picks(this.section ?? Infinity), pointer, projector, this.scale),
      ...this.edges(pointer, projector),
    ]
    return chooseHit(candidates, ground, depth, this.pickable)
  }

  private groundWithDepth(x: number, y: number): { ground: GroundHit | undefined; depth: number } {
    const { stage, rig, terrain } = this.scene
    const { width, height } = stage.size
    const { ray, stretch } = rig.rayThrough((x / width) * 2 - 1, 1 - (y / height) * 2)
    const ground = terrain.cast(ray, this.section)
    return { ground, depth: ground ? ground.distance / stretch : Infinity }
  }

  projector(): Projector {
    const { camera, size } = this.scene.stage
    const matrix = camera.projectionMatrix.clone().multiply(camera.matrixWorldInverse)
    this.matrix.set(matrix.elements)
    return new Projector(this.matrix, size.width, size.height)
  }

  private get scale(): number {
    const { camera, size } = this.scene.stage
    return size.height / (2 * Math.tan((camera.fov * Math.PI) / 360))
  }

  private npcs(pointer: Pointer, projector: Projector): Candidate[] {
    const ceiling = this.section ?? Infinity
    const points = this.scene.poses.shown
      .filter((npc) => npc.y <= ceiling)
      .map(({ id, x, y, z }): PickPoint => ({
        place: { x, y: y + 0.9, z },
        radius: 0.9,
        hit: { kind: 'npc', id, at: { x, y, z } },
      }))
    return pickPoint(points, pointer, projector, this.scale)
  }

  private vertices(pointer: Pointer, projector: Projector): Candidate[] {
    const { graph } = this.scene
    const ceiling = this.section ?? Infinity
    if (!graph.showsVertices) {
      return []
    }
    const points = (graph.graph?.vertices ?? []).flatMap(({ position, removed }, index): PickPoint[] =>
      position.y <= ceiling && removed !== true
        ? [
            {
              place: { ...position, y: position.y + LIFT_M },
              radius: VERTEX_M / 2,
              hit: { kind: 'vertex', index, at: position },
            },
          ]
        : [],
    )
    return pickPoint(points, pointer, projector, this.scale)
  }

  private edges(pointer: Pointer, projector: Projector): Candidate[] {
    this.lines ??= new ProjectedLines(
      this.scene.graph.edges.map(({ edge: { from, to }, points }) => ({
        points,
        hit: (at) => ({ kind: 'edge', from, to, at }),
      })),
      projector,
      this.section ?? Infinity,
    )
    return this.lines.pick(pointer)
  }
}
