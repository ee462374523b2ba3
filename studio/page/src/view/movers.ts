// Movers and players: what moves besides NPCs.

import { BufferAttribute, BufferGeometry, CapsuleGeometry, Group, Mesh } from 'three'
import { MARK_COLOURS, parseColour, type Rgb } from './colours'
import type { Materials } from './materials'
import type { PickPoint } from './picking'
import { Solids } from './shapes'
import type { MoverPose, MoverShape, PlayerPose } from './viewport.types'

/** Of doors, and of what carries. */
const DOOR: Rgb = [0.78, 0.52, 0.25]
const CARRIER: Rgb = [0.36, 0.6, 0.78]
const PLAYER = parseColour(MARK_COLOURS.player)

/** Triangles as they were modelled, around their pivot. */
function shapeOf({ positions, pivot, isDoor }: MoverShape): BufferGeometry {
  const geometry = new BufferGeometry()
  const corners = positions.length / 3
  const around = [pivot.x, pivot.y, pivot.z]
  const moved = positions.map((value, at) => value - (around[at % 3] ?? 0))
  geometry.setAttribute('position', new BufferAttribute(moved, 3))
  geometry.computeVertexNormals()
  const tint = isDoor ? DOOR : CARRIER
  geometry.setAttribute(
    'tint',
    new BufferAttribute(
      Float32Array.from({ length: corners * 3 }, (_, at) => tint[at % 3] ?? 1),
      3,
    ),
  )
  return geometry
}

export class MoverView extends Group {
  private shapes: MoverShape[] = []
  private readonly meshes: Mesh[] = []
  private readonly players: Mesh[] = []

  constructor(private readonly materials: Materials) {
    super()
  }

  set(shapes: MoverShape[]): void {
    this.removeMeshes()
    this.shapes = shapes
    for (const shape of shapes) {
      const mesh = new Mesh(shapeOf(shape), this.materials.solid)
      mesh.geometry.computeBoundingSphere()
      mesh.position.set(shape.pivot.x, shape.pivot.y, shape.pivot.z)
      mesh.frustumCulled = false
      this.meshes.push(mesh)
      this.add(mesh)
    }
  }

  /** Puts movers where they are, by index. */
  place(poses: ReadonlyMap<number, MoverPose>): void {
    for (const [index, { offset, yaw, isThere }] of poses) {
      const [mesh, shape] = [this.meshes[index], this.shapes[index]]
      if (mesh === undefined || shape === undefined) continue
      const { pivot } = shape
      mesh.position.set(pivot.x + offset.x, pivot.y + offset.y, pivot.z + offset.z)
      mesh.rotation.y = yaw
      mesh.visible = isThere
    }
  }

  /** What a pointer may meet: the middle of each mover that is there, not above `ceiling`, m. */
  picks(ceiling: number): PickPoint[] {
    return this.meshes.flatMap((mesh, index) => {
      const sphere = mesh.geometry.boundingSphere
      if (!mesh.visible || sphere === null) return []
      const { x, y, z } = mesh.localToWorld(sphere.center.clone())
      const place = { x, y, z }
      // Doors are thin: half of what surrounds one is beside it.
      return y <= ceiling ? [{ place, radius: sphere.radius / 2, hit: { kind: 'mover', index, at: place } }] : []
    })
  }

  setPlayers(players: readonly PlayerPose[]): void {
    while (this.players.length > players.length) this.drop(this.players.pop())
    players.forEach(({ position, radius, height }, index) => {
      const mesh = this.players[index] ?? this.addPlayer()
      mesh.position.set(position.x, position.y, position.z)
      mesh.scale.set(radius / 0.3, height / 1.8, radius / 0.3)
    })
  }

  override dispose(): void {
    this.removeMeshes()
    this.setPlayers([])
  }

  private addPlayer(): Mesh {
    const solid = new Solids().at(new CapsuleGeometry(0.3, 1.2, 3, 10), PLAYER, { x: 0, y: 0.9, z: 0 })
    const mesh = new Mesh(solid.build(), this.materials.solid)
    mesh.frustumCulled = false
    this.players.push(mesh)
    this.add(mesh)
    return mesh
  }

  private removeMeshes(): void {
    for (const mesh of this.meshes.splice(0)) this.drop(mesh)
  }

  private drop(mesh: Mesh | undefined): void {
    if (mesh === undefined) return
    this.remove(mesh)
    mesh.geometry.dispose()
  }
}
