// Tiles of the ground as meshes: fine ones where there are any, coarse ones elsewhere.

import {
  BufferAttribute,
  BufferGeometry,
  Frustum,
  Group,
  Matrix4,
  Mesh,
  type PerspectiveCamera,
  PlaneGeometry,
} from 'three'
import { castGround, type GroundHit, GroundTile, type Ray } from './ground'
import type { Materials } from './materials'
import { type ShadedTile, shadeTile } from './shading'
import { Solids } from './shapes'
import { chooseLevels, type LeveledTile, LEVELS_M, simplifyTile } from './simplify'
import type { Palette } from './theme'
import { type KeptTile, TileStore } from './tiles'
import type { Box, MeshTile, Place } from './viewport.types'

/** Triangles of fine tiles that are kept at once. */
const FINE_TRIANGLES = 2_500_000

/** Rock nearer than this to what is looked at does not hide it, m. */
const HIDING_M = 1.2

/** Triangles of a quick picture. */
const QUICK_TRIANGLES = 24_000

interface Tile extends KeptTile {
  mesh: Mesh
  ground: GroundTile
  shaded: ShadedTile
  /** Geometries by level of LEVELS_M, made on first use. */
  levels: (BufferGeometry | undefined)[]
}

export class Terrain extends Group {
  private readonly store = new TileStore<Tile>()
  private fine: ReadonlySet<string> = new Set()
  private floor: Mesh | undefined
  private palette: Palette

  constructor(
    private readonly materials: Materials,
    palette: Palette,
  ) {
    super()
    this.palette = palette
  }

  put(tile: MeshTile, fine: boolean, around: Place): void {
    const key = `${tile.tileX},${tile.tileZ}`
    const kept = this.make(tile)
    this.drop(this.store.put(key, kept, fine))
    this.show(key)
    for (const evicted of this.store.evict(around, FINE_TRIANGLES)) {
      this.drop(evicted.tile)
      this.show(evicted.key)
    }
    this.fine = this.store.fineKeys()
    this.measure()
  }

  /** Takes a tile away: nothing is left there. */
  dropTile(key: string): void {
    for (const tile of this.store.remove(key)) this.drop(tile)
    this.show(key)
    this.fine = this.store.fineKeys()
    this.measure()
  }

  get fineKeys(): ReadonlySet<string> {
    return this.fine
  }

  /** Around all tiles that are shown. */
  box(): Box | undefined {
    const low = { x: Infinity, y: Infinity, z: Infinity }
    const high = { x: -Infinity, y: -Infinity, z: -Infinity }
    for (const [, { ground }] of this.store.allShown()) {
      for (const [at, axis] of (['x', 'y', 'z'] as const).entries()) {
        low[axis] = Math.min(low[axis], ground.low[at]!)
        high[axis] = Math.max(high[axis], ground.high[at]!)
      }
    }
    return low.x <= high.x ? { low, high } : undefined
  }

  cast(ray: Ray, ceiling: number | undefined): GroundHit | undefined {
    return castGround(this.grounds(), ray, ceiling)
  }

  /** Whether rock is between two places. */
  hides(from: Place, to: Place, ceiling: number | undefined): boolean {
    const [x, y, z] = [to.x - from.x, to.y - from.y, to.z - from.z]
    const length = Math.hypot(x, y, z)
    const direction = { x: x / length, y: y / length, z: z / length }
    const met = this.cast({ origin: { x: from.x, y: from.y, z: from.z }, direction }, ceiling)
    return met !== undefined && met.distance < length - HIDING_M
  }

  /** Takes rougher tiles where they are many or far, so that a picture comes quickly; or whole ones again. */
  setQuick(quick: boolean, camera: PerspectiveCamera): void {
    const shown = [...this.store.allShown()].map(([, tile]) => tile)
    if (!quick) {
      shown.forEach((tile) => (tile.mesh.geometry = tile.levels[0]!))
      return
    }
    const matrix = new Matrix4().multiplyMatrices(camera.projectionMatrix, camera.matrixWorldInverse)
    const frustum = new Frustum().setFromProjectionMatrix(matrix)
    const seen = shown.filter((tile) => frustum.intersectsSphere(tile.levels[0]!.boundingSphere!))
    const levels = chooseLevels(
      seen.map((tile) => leveled(tile, camera.position)),
      QUICK_TRIANGLES,
    )
    for (const [at, tile] of seen.entries()) {
      const level = levels[at]!
      tile.mesh.geometry = tile.levels[level] ??= geometryOf(simplifyTile(tile.shaded, LEVELS_M[level]!))
    }
  }

  /** With a section, rock that is cut open is closed by a floor below the map. */
  setSection(cut: boolean): void {
    this.removeFloor()
    const box = cut && this.box()
    if (!box) {
      return
    }
    const { low, high } = box
    const shape = new PlaneGeometry(high.x - low.x, high.z - low.z)
    const place = new Matrix4()
      .makeRotationX(-Math.PI / 2)
      .setPosition((low.x + high.x) / 2, low.y - 0.5, (low.z + high.z) / 2)
    this.floor = new Mesh(new Solids().add(shape, this.palette.cut, place).build(), this.materials.bedrock)
    this.add(this.floor)
  }

  setPalette(palette: Palette): void {
    this.palette = palette
    this.setSection(this.floor !== undefined)
  }

  clearTiles(): void {
    for (const tile of this.store.all()) {
      this.drop(tile)
    }
    this.store.clear()
    this.fine = new Set()
    this.removeFloor()
  }

  private *grounds(): Generator<GroundTile> {
    for (const [, tile] of this.store.allShown()) {
      yield tile.ground
    }
  }

  private make(tile: MeshTile): Tile {
    const shaded = shadeTile(tile)
    const whole = geometryOf(shaded)
    const mesh = new Mesh(whole, this.materials.terrain)
    mesh.matrixAutoUpdate = false
    const ground = new GroundTile(tile)
    const middle = { x: (ground.low[0] + ground.high[0]) / 2, z: (ground.low[2] + ground.high[2]) / 2 }
    return { mesh, ground, middle, triangles: tile.indices.length / 3, shaded, levels: [whole] }
  }

  private show(key: string): void {
    const shown = this.store.shown(key)
    for (const other of this.children.filter((it) => it.name === key && it !== shown?.mesh)) {
      this.remove(other)
    }
    if (shown && shown.mesh.parent !== this) {
      shown.mesh.name = key
      this.add(shown.mesh)
    }
  }

  private drop(tile: Tile | undefined): void {
    if (tile) {
      this.remove(tile.mesh)
      tile.levels.forEach((geometry) => geometry?.dispose())
    }
  }

  private measure(): void {
    const box = this.box()
    if (box) {
      this.materials.uniforms.uHeights.value.set(box.low.y, Math.max(10, box.high.y - box.low.y))
    }
  }

  private removeFloor(): void {
    if (this.floor) {
      this.remove(this.floor)
      this.floor.geometry.dispose()
      this.floor = undefined
    }
  }
}

function geometryOf(shaded: ShadedTile): BufferGeometry {
  const geometry = new BufferGeometry()
  geometry.setAttribute('position', new BufferAttribute(shaded.positions, 3))
  geometry.setAttribute('tone', new BufferAttribute(shaded.tones, 4, true))
  geometry.setIndex(new BufferAttribute(shaded.indices, 1))
  geometry.computeBoundingSphere()
  return geometry
}

function leveled({ ground: { low, high }, levels }: Tile, eye: Place): LeveledTile {
  const gap = (at: number, axis: 0 | 1 | 2): number => Math.max(low[axis] - at, 0, at - high[axis])
  const distance = Math.hypot(gap(eye.x, 0), gap(eye.y, 1), gap(eye.z, 2))
  const counts = levels.map((geometry) => geometry && geometry.getIndex()!.count / 3)
  return { counts, distance, area: (high[0] - low[0]) * (high[2] - low[2]) }
}
