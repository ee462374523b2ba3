// What stands on a map besides rock: pools, pads, zip lines, teleporters, jetpacks, spots.

import {
  BufferGeometry,
  CapsuleGeometry,
  CircleGeometry,
  ConeGeometry,
  CylinderGeometry,
  Group,
  Matrix4,
  Mesh,
  OctahedronGeometry,
  PlaneGeometry,
  TorusGeometry,
} from 'three'
import { Ability } from '../gen/surefoot/world/v1/map_pb'
import { abilityColour, mixColours, type Rgb } from './colours'
import { arc } from './edge-shape'
import type { Materials } from './materials'
import { ArrowBatch, LineBatch } from './overlays'
import { Solids } from './shapes'
import type { Palette } from './theme'
import type { Features, Place } from './viewport.types'

const DISC_M = 1.25
/** Height of a cable above its ends on the ground, m: an NPC holds it with its hands. */
const CABLE_M = 3.4
const PAD = abilityColour(Ability.PAD)
const ZIP = abilityColour(Ability.ZIP_LINE)
const TELEPORTER = abilityColour(Ability.TELEPORTER)
const JETPACK = abilityColour(Ability.JETPACK)
const SPOT = abilityColour(Ability.OWN_1)

type Pool = Features['pools'][number]

const lifted = (place: Place, by: number): Place => ({ ...place, y: place.y + by })

/** A level outline, from -1 to 1, laid over the pool. */
function surfaceOf(pool: Pool, below: number): { shape: BufferGeometry; place: Matrix4 } {
  const shape = pool.round ? new CircleGeometry(1, 40) : new PlaneGeometry(2, 2)
  const place = new Matrix4()
    .makeTranslation(pool.centre.x, pool.centre.y + 0.03 - below, pool.centre.z)
    .multiply(new Matrix4().makeScale(pool.halfX, 1, pool.halfZ))
    .multiply(new Matrix4().makeRotationX(-Math.PI / 2))
  return { shape, place }
}

/** Two layers of water: the lower one makes the middle look deeper. */
function addWater(solids: Solids, pool: Pool, palette: Palette): void {
  const upper = surfaceOf(pool, 0)
  solids.add(upper.shape, palette.water, upper.place)
  const deep = surfaceOf({ ...pool, halfX: pool.halfX * 0.7, halfZ: pool.halfZ * 0.7 }, Math.min(pool.depth * 0.4, 0.6))
  solids.add(deep.shape, mixColours(palette.water, [0, 0.05, 0.2], 0.5), deep.place)
}

/** A crust around a brighter middle. */
function addLava(solids: Solids, pool: Pool, palette: Palette): void {
  for (const [share, colour] of [
    [1, mixColours(palette.lava, [0.35, 0.02, 0], 0.55)],
    [0.88, palette.lava],
    [0.5, mixColours(palette.lava, [1, 0.85, 0.3], 0.55)],
  ] as const) {
    const layer = surfaceOf({ ...pool, halfX: pool.halfX * share, halfZ: pool.halfZ * share }, (share - 1) * 0.06)
    solids.add(layer.shape, colour, layer.place)
  }
}

function addDisc(solids: Solids, at: Place, colour: Rgb, metal: Rgb): void {
  solids.at(new CylinderGeometry(DISC_M, DISC_M + 0.1, 0.14, 14), metal, at, 0.07)
  solids.at(new CircleGeometry(DISC_M * 0.8, 14).rotateX(-Math.PI / 2), colour, at, 0.17)
}

/** A disc with an arrow that is the longer the higher it throws. */
function addPad(solids: Solids, at: Place, speed: number, metal: Rgb): void {
  addDisc(solids, at, PAD, metal)
  const shaft = Math.min(2.4, 0.5 + speed * 0.06)
  solids.bar(lifted(at, 0.5), lifted(at, 0.5 + shaft), 0.12, PAD)
  solids.at(new ConeGeometry(0.42, 0.7, 7), PAD, at, 0.85 + shaft)
}

function addZipLine(solids: Solids, lines: LineBatch, arrows: ArrowBatch, from: Place, to: Place, metal: Rgb): void {
  addDisc(solids, from, ZIP, metal)
  const [top, end] = [lifted(from, CABLE_M), lifted(to, CABLE_M)]
  for (const [foot, head] of [
    [from, top],
    [to, end],
  ] as const) {
    solids.bar(foot, lifted(head, 0.25), 0.11, metal)
  }
  lines.line(top, end, { colour: ZIP, width: 2 })
  for (const share of [0.35, 0.65]) {
    const at = (part: number): Place => ({
      x: top.x + (end.x - top.x) * part,
      y: top.y + (end.y - top.y) * part,
      z: top.z + (end.z - top.z) * part,
    })
    arrows.arrow(at(share), at(share + 0.02), ZIP)
  }
}

function addTeleporter(
  solids: Solids,
  dashes: LineBatch,
  arrows: ArrowBatch,
  line: Features['teleporters'][number],
  metal: Rgb,
): void {
  for (const at of [line.from, line.to]) {
    addDisc(solids, at, TELEPORTER, metal)
  }
  for (const at of line.twoWay ? [line.from, line.to] : [line.from]) {
    solids.add(new TorusGeometry(0.95, 0.09, 5, 18), TELEPORTER, new Matrix4().makeTranslation(at.x, at.y + 1.15, at.z))
  }
  const points = arc(line.from, line.to, Ability.TELEPORTER, 'smooth')
  dashes.polyline(points, { colour: TELEPORTER, width: 1.6, dash: 3, opacity: 0.8 })
  const place = (index: number): Place => ({
    x: points[index * 3]!,
    y: points[index * 3 + 1]!,
    z: points[index * 3 + 2]!,
  })
  const middle = Math.floor(points.length / 6)
  arrows.arrow(place(middle), place(middle + 1), TELEPORTER)
}

/** A diamond at a place for moves, or at both ends of a way, with a line between them. */
function addSpot(solids: Solids, dashes: LineBatch, arrows: ArrowBatch, spot: Features['spots'][number]): void {
  const ends = spot.to === undefined ? [spot.from] : [spot.from, spot.to]
  ends.forEach((at) => solids.at(new OctahedronGeometry(0.3), SPOT, at, 0.3))
  if (spot.to === undefined) return
  dashes.polyline(arc(spot.from, spot.to, Ability.OWN_1, 'smooth'), { colour: SPOT, width: 1.6, dash: 3, opacity: 0.8 })
  const at = (share: number): Place => ({
    x: spot.from.x + (spot.to!.x - spot.from.x) * share,
    y: spot.from.y + (spot.to!.y - spot.from.y) * share,
    z: spot.from.z + (spot.to!.z - spot.from.z) * share,
  })
  arrows.arrow(at(0.5), at(0.52), SPOT)
}

/** Two tanks with nozzles over a disc. */
function addJetpack(solids: Solids, at: Place, metal: Rgb): void {
  addDisc(solids, at, JETPACK, metal)
  for (const side of [-0.26, 0.26]) {
    const tank = { x: at.x + side, y: at.y, z: at.z }
    solids.at(new CapsuleGeometry(0.22, 0.6, 3, 8), JETPACK, tank, 1.25)
    solids.at(new ConeGeometry(0.2, 0.3, 8), metal, tank, 0.72)
  }
  solids.bar(lifted({ ...at, x: at.x - 0.3 }, 1.35), lifted({ ...at, x: at.x + 0.3 }, 1.35), 0.08, metal)
}

export class FeatureView extends Group {
  private features: Features | undefined
  private readonly lines: LineBatch
  private readonly dashes: LineBatch
  private readonly arrows: ArrowBatch
  private meshes: Mesh[] = []

  constructor(
    private readonly materials: Materials,
    private palette: Palette,
  ) {
    super()
    this.lines = new LineBatch(materials, 'lines', 5)
    this.dashes = new LineBatch(materials, 'dashes', 5)
    this.arrows = new ArrowBatch(materials, 6)
    this.add(this.lines, this.dashes, this.arrows)
  }

  get size(): Features['size'] | undefined {
    return this.features?.size
  }

  set(features: Features | undefined): void {
    this.features = features
    this.rebuild()
  }

  setPalette(palette: Palette): void {
    this.palette = palette
    this.rebuild()
  }

  override dispose(): void {
    this.removeMeshes()
    this.lines.dispose()
    this.dashes.dispose()
    this.arrows.dispose()
  }

  private rebuild(): void {
    this.removeMeshes()
    const { palette } = this
    const devices = new Solids()
    const glass = new Solids()
    const glowing = new Solids()
    for (const pool of this.features?.pools ?? []) {
      if (pool.lava) {
        addLava(glowing, pool, palette)
      } else {
        addWater(glass, pool, palette)
      }
    }
    this.features?.pads.forEach((pad) => addPad(devices, pad.centre, pad.speed, palette.metal))
    this.features?.zipLines.forEach(({ from, to }) =>
      addZipLine(devices, this.lines, this.arrows, from, to, palette.metal),
    )
    this.features?.teleporters.forEach((line) => addTeleporter(devices, this.dashes, this.arrows, line, palette.metal))
    this.features?.jetpacks.forEach((at) => addJetpack(devices, at, palette.metal))
    this.features?.spots.forEach((spot) => addSpot(devices, this.dashes, this.arrows, spot))
    this.lines.commit()
    this.dashes.commit()
    this.arrows.commit()
    this.addMesh(new Mesh(devices.build(), this.materials.solid), 0)
    this.addMesh(new Mesh(glowing.build(), this.materials.glowing), 0)
    this.addMesh(new Mesh(glass.build(), this.materials.glass), 1)
  }

  private addMesh(mesh: Mesh, order: number): void {
    mesh.renderOrder = order
    mesh.visible = mesh.geometry.getAttribute('position').count > 0
    mesh.frustumCulled = false
    this.meshes.push(mesh)
    this.add(mesh)
  }

  private removeMeshes(): void {
    for (const mesh of this.meshes) {
      this.remove(mesh)
      mesh.geometry.dispose()
    }
    this.meshes = []
  }
}
