// Solid shapes put together from simple ones: each corner has a normal and a tint.

import {
  BufferAttribute,
  BufferGeometry,
  CapsuleGeometry,
  ConeGeometry,
  CylinderGeometry,
  Matrix4,
  Quaternion,
  SphereGeometry,
  TorusGeometry,
  Vector3,
} from 'three'
import type { Rgb } from './colours'
import type { Place } from './viewport.types'

const UP = new Vector3(0, 1, 0)
const WHITE: Rgb = [1, 1, 1]
const ORIGIN: Place = { x: 0, y: 0, z: 0 }

/** Puts solids together into one geometry. */
export class Solids {
  private readonly positions: number[] = []
  private readonly normals: number[] = []
  private readonly tints: number[] = []
  private readonly indices: number[] = []

  add(shape: BufferGeometry, tint: Rgb, place: Matrix4): this {
    const placed = shape.applyMatrix4(place)
    const first = this.positions.length / 3
    const position = placed.getAttribute('position')
    this.positions.push(...position.array)
    this.normals.push(...placed.getAttribute('normal').array)
    for (let corner = 0; corner < position.count; corner += 1) {
      this.tints.push(...tint)
    }
    const index = placed.getIndex()
    const count = index?.count ?? position.count
    for (let at = 0; at < count; at += 1) {
      this.indices.push(first + (index ? index.getX(at) : at))
    }
    placed.dispose()
    return this
  }

  at(shape: BufferGeometry, tint: Rgb, place: Place, lift = 0): this {
    return this.add(shape, tint, new Matrix4().makeTranslation(place.x, place.y + lift, place.z))
  }

  /** A round bar between two points. */
  bar(from: Place, to: Place, radius: number, tint: Rgb, sides = 6): this {
    const way = new Vector3(to.x - from.x, to.y - from.y, to.z - from.z)
    const length = way.length()
    const turn = new Quaternion().setFromUnitVectors(UP, way.divideScalar(length || 1))
    const middle = new Vector3((from.x + to.x) / 2, (from.y + to.y) / 2, (from.z + to.z) / 2)
    const place = new Matrix4().compose(middle, turn, new Vector3(1, 1, 1))
    return this.add(new CylinderGeometry(radius, radius, length, sides, 1, true), tint, place)
  }

  build(): BufferGeometry {
    const geometry = new BufferGeometry()
    geometry.setAttribute('position', new BufferAttribute(Float32Array.from(this.positions), 3))
    geometry.setAttribute('normal', new BufferAttribute(Float32Array.from(this.normals), 3))
    geometry.setAttribute('tint', new BufferAttribute(Float32Array.from(this.tints), 3))
    geometry.setIndex(new BufferAttribute(Uint32Array.from(this.indices), 1))
    geometry.computeBoundingSphere()
    return geometry
  }
}

/** An NPC, feet at the origin, looking along +z; `fine`: round also from near. */
export function npcShape(fine: boolean): BufferGeometry {
  const round = fine ? 14 : 6
  const visor = new Matrix4().makeScale(0.85, 0.62, 0.62).setPosition(0, 1.56, 0.14)
  return new Solids()
    .at(new CapsuleGeometry(0.37, 0.55, fine ? 4 : 1, round), WHITE, ORIGIN, 0.65)
    .at(new SphereGeometry(0.27, round, fine ? 10 : 4), [1.3, 1.3, 1.3], ORIGIN, 1.53)
    .add(new SphereGeometry(0.27, round, fine ? 8 : 4), [0.12, 0.14, 0.18], visor)
    .build()
}

/** A pole with a flag, foot at the origin. */
export function flagShape(tint: Rgb): BufferGeometry {
  const cloth = new BufferGeometry()
  const corners = [0, 3.2, 0, 0, 2.2, 0, 1.4, 2.7, 0, 0, 3.2, 0, 1.4, 2.7, 0, 0, 2.2, 0]
  cloth.setAttribute('position', new BufferAttribute(Float32Array.from(corners), 3))
  cloth.computeVertexNormals()
  return new Solids()
    .bar({ x: 0, y: 0, z: 0 }, { x: 0, y: 3.2, z: 0 }, 0.06, [0.92, 0.94, 0.97])
    .add(cloth, tint, new Matrix4())
    .at(new SphereGeometry(0.13, 8, 6), tint, { x: 0, y: 3.25, z: 0 })
    .build()
}

/** A pin as on road maps, tip at the origin. */
export function pinShape(tint: Rgb): BufferGeometry {
  const tip = new Matrix4().makeRotationX(Math.PI).setPosition(0, 0.9, 0)
  return new Solids()
    .add(new ConeGeometry(0.46, 1.8, 12), tint, tip)
    .at(new SphereGeometry(0.62, 14, 10), tint, { x: 0, y: 2, z: 0 })
    .at(new SphereGeometry(0.24, 8, 6), WHITE, { x: 0, y: 2.55, z: 0 })
    .build()
}

/** A flat ring around the origin. */
export function ringShape(tint: Rgb, radius: number, thick: number): BufferGeometry {
  return new Solids()
    .add(new TorusGeometry(radius, thick, 6, 32), tint, new Matrix4().makeRotationX(Math.PI / 2))
    .build()
}
