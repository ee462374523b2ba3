// The area that an NPC reaches, coloured by the time to get there.

import { BufferAttribute, BufferGeometry, Group, Mesh } from 'three'
import { MARK_COLOURS, parseColour, secondsColour } from './colours'
import type { Ray } from './ground'
import type { Materials } from './materials'
import { SpriteBatch } from './overlays'
import { layCells, type ReachSheet, trianglesWithin } from './reach-shape'
import type { ReachArea, ReachCell } from './viewport.types'

const START = { colour: parseColour(MARK_COLOURS.start), shape: 'disc', size: 0.9, least: 10, most: 18 } as const

export class ReachView extends Group {
  private readonly meshes: Mesh[]
  private readonly start: SpriteBatch
  /** The cells that were laid last: other seconds need no other corners. */
  private laid: { cells: readonly ReachCell[]; sheet: ReachSheet } | undefined

  constructor(
    materials: Materials,
    private readonly cast: (ray: Ray) => number | undefined,
  ) {
    super()
    const { plain, behind } = materials.areas
    this.meshes = [new Mesh(new BufferGeometry(), behind), new Mesh(new BufferGeometry(), plain)]
    this.meshes.forEach((mesh, order) => {
      mesh.frustumCulled = false
      mesh.renderOrder = 2 + order * 0.1
      mesh.userData['behind'] = mesh.material === behind
    })
    this.start = new SpriteBatch(materials, 23)
    this.add(...this.meshes, this.start)
    this.set(undefined)
  }

  set(area: ReachArea | undefined): void {
    if (area) this.start.sprite(area.start, START, 0.4)
    this.start.commit()
    this.meshes[0]!.geometry.dispose()
    const geometry = area ? this.geometryOf(area) : new BufferGeometry()
    for (const mesh of this.meshes) mesh.geometry = geometry
    this.visible = area !== undefined
    if (!area) this.laid = undefined
  }

  override dispose(): void {
    this.meshes[0]!.geometry.dispose()
    this.start.dispose()
  }

  private geometryOf({ cells, side, limit }: ReachArea): BufferGeometry {
    if (this.laid?.cells !== cells) this.laid = { cells, sheet: layCells(cells, side, this.cast) }
    const { sheet } = this.laid
    const geometry = new BufferGeometry()
    const tints = Float32Array.from([...sheet.seconds].flatMap((seconds) => [...secondsColour(seconds / limit)]))
    geometry.setAttribute('position', new BufferAttribute(sheet.positions, 3))
    geometry.setAttribute('tint', new BufferAttribute(tints, 3))
    geometry.setIndex(new BufferAttribute(Uint32Array.from(trianglesWithin(sheet, limit)), 1))
    return geometry
  }
}
