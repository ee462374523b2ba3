// The NPC as a figure of boxes, whose limbs follow how it moves. A game blends the clips of a model by the same values.

import * as THREE from 'three'
import type { Body, Locomotion } from '../../dist/index.js'

/** Swing of the limbs, rad, and lean of the trunk, rad, by pace. */
const SWING = { idle: 0, turn: 0.15, walk: 0.45, run: 0.9, stop: 0.3 }
const LEAN = { idle: 0, turn: 0, walk: 0.03, run: 0.18, stop: -0.12 }
/** Share of the way to the wanted posture in a frame. */
const BLEND = 0.25

export class Figure {
  /** Faces +z. */
  readonly group = new THREE.Group()
  private readonly trunk = new THREE.Group()
  private readonly legs: THREE.Group[]
  private readonly arms: THREE.Group[]
  private swing = 0

  constructor({ height, radius }: Body) {
    const skin = new THREE.MeshLambertMaterial({ color: 0xff7744 })
    const box = (width: number, length: number, depth: number, y: number) => {
      const mesh = new THREE.Mesh(new THREE.BoxGeometry(width, length, depth), skin)
      mesh.position.y = y
      return mesh
    }
    const limb = (side: number, x: number, width: number, length: number) => {
      const pivot = new THREE.Group().add(box(width, length, width, -length / 2))
      pivot.position.x = side * x
      return pivot
    }
    const hip = 0.53 * height
    this.legs = [1, -1].map((side) => limb(side, 0.4 * radius, 0.5 * radius, hip))
    this.arms = [1, -1].map((side) => limb(side, 0.9 * radius, 0.35 * radius, 0.35 * height))
    this.arms.forEach((arm) => (arm.position.y = 0.3 * height))
    const nose = box(0.1, 0.1, 0.3, 0.4 * height)
    nose.position.z = 0.5 * radius
    this.trunk.add(box(1.3 * radius, 0.3 * height, 0.7 * radius, 0.16 * height), nose, ...this.arms)
    this.trunk.add(box(0.7 * radius, 0.13 * height, 0.7 * radius, 0.4 * height))
    this.trunk.position.y = hip
    this.legs.forEach((leg) => (leg.position.y = hip))
    this.group.add(this.trunk, ...this.legs)
  }

  /** Moves towards the posture of a frame. */
  animate({ pace, phase, stridePhase }: Locomotion): void {
    const blend = (from: number, to: number) => from + BLEND * (to - from)
    this.swing = blend(this.swing, phase === 'flight' ? 0 : SWING[pace])
    this.trunk.rotation.x = blend(this.trunk.rotation.x, phase === 'landing' ? 0.4 : LEAN[pace])
    const angle = this.swing * Math.sin(2 * Math.PI * stridePhase)
    // In flight one leg is ahead and the arms are up; a landing bends the figure.
    const [ahead, raised] = phase === 'flight' ? [0.6, 1.2] : [0, 0]
    this.legs.forEach((leg, idx) => {
      const side = idx === 0 ? 1 : -1
      leg.rotation.x = blend(leg.rotation.x, side * (angle - ahead))
      this.arms[idx]!.rotation.x = blend(this.arms[idx]!.rotation.x, -side * angle - raised)
    })
    this.group.scale.y = blend(this.group.scale.y, phase === 'landing' ? 0.9 : 1)
  }
}
