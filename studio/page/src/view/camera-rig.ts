// The camera: where it is, where it is going, whom it follows.

import { type PerspectiveCamera, Vector3 } from 'three'
import { type Angles, CHASE_M, turnCalmly } from './chase'
import { approach, copyPose, fitBox, lensOf, type OrbitPose, pan, rotate, samePose, zoom } from './orbit'
import type { Ray } from './ground'
import type { Box, CameraPose, Place } from './viewport.types'

/** How quickly the camera comes where it should be, ms. */
const HAND_MS = 45
const FLIGHT_MS = 220
const FOLLOW_MS = 140
/** Polar angle of the view from the side. */
const SIDE_POLAR = 0.95
const SIDE_AZIMUTH = 0.6
/** A place that is looked at is seen from this near at most, m. */
const LOOK_M = 45
/** Around a box that is framed there is a margin of this share of its size, and of so much at least, m. */
const MARGIN = 0.3
const LEAST_MARGIN_M = 2
/** Over the feet of the NPC that the camera follows, m. */
const FOLLOW_LIFT_M = 2.2

export class CameraRig {
  private readonly goal: OrbitPose = {
    target: { x: 125, y: 20, z: 125 },
    distance: 250,
    azimuth: SIDE_AZIMUTH,
    polar: SIDE_POLAR,
    flat: 0,
  }
  private readonly shown = copyPose(this.goal)
  private readonly before = copyPose(this.goal)
  private timeMs = HAND_MS
  private sidePolar = SIDE_POLAR
  private extent = 350
  private readonly calm = window.matchMedia('(prefers-reduced-motion: reduce)')
  private followed: bigint | undefined
  /** It has yet to come near to the one that it follows. */
  private arriving = false
  /** The user has turned the camera while it follows. */
  private steered = false
  private wanted: Angles | undefined
  private hurried = false

  constructor(private readonly camera: PerspectiveCamera) {}

  get pose(): Readonly<OrbitPose> {
    return this.shown
  }

  get top(): boolean {
    return this.goal.flat > 0.5
  }

  get following(): bigint | undefined {
    return this.followed
  }

  /** Whether the camera chooses its own angles: while it follows an NPC and the user has not turned it. */
  get steersItself(): boolean {
    return this.followed !== undefined && !this.steered && !this.top
  }

  /** Follows an NPC from near by, or stays where it is. */
  follow(id: bigint | undefined): void {
    this.followed = id
    this.arriving = id !== undefined
    this.steered = false
    this.wanted = undefined
  }

  /** The angles to follow from; `hurried`: rock hides the NPC at present. */
  steer(angles: Angles, hurried: boolean): void {
    this.wanted = angles
    this.hurried = hurried
  }

  /** The NPC that it follows was put elsewhere. */
  arriveAgain(): void {
    this.arriving = this.steersItself
  }

  /** How it would stand to follow what is at `target` from these angles. */
  chasePose(target: Place, angles: Angles): OrbitPose {
    return { ...this.goal, ...angles, target, distance: this.arriving ? CHASE_M : this.goal.distance }
  }

  /** Where the camera is on its way to, as links keep it. */
  get kept(): CameraPose {
    const { target, distance, azimuth, polar } = this.goal
    return { target: { ...target }, distance, azimuth, polar }
  }

  /** Goes there at once, and goes on following if it does. */
  restore({ target, distance, azimuth, polar }: CameraPose): void {
    Object.assign(this.goal, { target: { ...target }, distance, azimuth, polar: this.top ? 0 : polar })
    this.arriving = false
    this.steered = true
    approach(this.shown, this.goal, 1, 0)
  }

  rotate(dx: number, dy: number, height: number): void {
    this.steered = true
    rotate(this.goal, dx, dy, height)
    this.timeMs = HAND_MS
  }

  pan(dx: number, dy: number, height: number): void {
    pan(this.goal, dx, dy, height)
    this.timeMs = HAND_MS
  }

  /** Towards `at`, or towards the NPC that it follows. */
  zoom(factor: number, at: Place | undefined): void {
    zoom(this.goal, factor, this.followed === undefined ? at : undefined)
    this.timeMs = HAND_MS
  }

  /** Moves with what it looks at. */
  move({ x, y, z }: Place): void {
    const { target } = this.goal
    this.goal.target = { x: target.x + x, y: target.y + y, z: target.z + z }
    this.timeMs = HAND_MS
  }

  lookAt(place: Place, within = LOOK_M): void {
    this.goal.target = { ...place }
    this.goal.distance = Math.min(this.goal.distance, within)
    this.timeMs = FLIGHT_MS
  }

  setTop(top: boolean): void {
    if (top === this.top) {
      return
    }
    if (top) {
      this.sidePolar = this.goal.polar
    }
    this.goal.flat = top ? 1 : 0
    this.goal.polar = top ? 0 : Math.max(this.sidePolar, 0.4)
    this.timeMs = FLIGHT_MS
  }

  frame({ low, high }: Box, aspect: number, flight: boolean): void {
    const { goal } = this
    goal.azimuth = this.top ? 0 : SIDE_AZIMUTH
    goal.polar = this.top ? 0 : SIDE_POLAR
    Object.assign(goal, fitBox(goal, low, high, aspect))
    this.timeMs = FLIGHT_MS
    if (!flight) {
      approach(this.shown, goal, 1, 0)
    }
  }

  /** Shows a box with what is around it, from the present side. */
  frameFromHere({ low, high }: Box, aspect: number): void {
    const size = Math.max(high.x - low.x, high.y - low.y, high.z - low.z)
    const margin = Math.max(LEAST_MARGIN_M, size * MARGIN)
    const grown = (place: Place, by: number): Place => ({ x: place.x + by, y: place.y + by, z: place.z + by })
    Object.assign(this.goal, fitBox(this.goal, grown(low, -margin), grown(high, margin), aspect))
    this.timeMs = FLIGHT_MS
  }

  setExtent({ low, high }: Box): void {
    this.extent = Math.hypot(high.x - low.x, high.y - low.y, high.z - low.z)
  }

  /** Moves on by `elapsed` ms; tells whether the camera has moved. `followed`: where the NPC is that it follows. */
  update(elapsed: number, followed: Place | undefined): boolean {
    if (followed) {
      this.keepUp(elapsed, followed)
    }
    const { shown, before } = this
    Object.assign(before, shown)
    before.target = { ...shown.target }
    const timeMs = this.calm.matches ? 0 : followed ? Math.max(FOLLOW_MS, this.timeMs) : this.timeMs
    approach(shown, this.goal, elapsed, timeMs)
    return !samePose(before, shown)
  }

  private keepUp(elapsed: number, { x, y, z }: Place): void {
    const { goal, wanted } = this
    goal.target.x = x
    goal.target.y = y + FOLLOW_LIFT_M
    goal.target.z = z
    if (this.arriving) {
      this.arriving = false
      this.timeMs = FLIGHT_MS
      goal.distance = this.top ? Math.min(goal.distance, LOOK_M) : CHASE_M
      if (wanted && this.steersItself) {
        Object.assign(goal, wanted)
      }
    } else if (wanted && this.steersItself && !this.calm.matches) {
      turnCalmly(goal, wanted, elapsed, this.hurried)
    }
  }

  /** Puts the camera where it is; returns the height in pixels of one metre at a distance of one metre. */
  apply(width: number, height: number): number {
    const lens = lensOf(this.shown, this.extent)
    const { camera } = this
    camera.position.set(lens.eye.x, lens.eye.y, lens.eye.z)
    camera.rotation.set(this.shown.polar - Math.PI / 2, this.shown.azimuth, 0, 'YXZ')
    camera.fov = (lens.fieldOfView * 180) / Math.PI
    camera.near = lens.near
    camera.far = lens.far
    camera.aspect = width / height
    camera.updateProjectionMatrix()
    camera.updateMatrixWorld()
    return height / (2 * Math.tan(lens.fieldOfView / 2))
  }

  /** From how far away fog begins and where it is thickest, m. */
  fogRange(): [number, number] {
    const { eye } = lensOf(this.shown, this.extent)
    const { target } = this.shown
    const away = Math.hypot(eye.x - target.x, eye.y - target.y, eye.z - target.z)
    return [away + this.extent * 0.7, away + this.extent * 2.2]
  }

  /** The ray through a point of the picture, from -1 to 1, and how much longer than its depth it is. */
  rayThrough(x: number, y: number): { ray: Ray; stretch: number } {
    const { camera } = this
    const tangent = Math.tan((camera.fov * Math.PI) / 360)
    const direction = new Vector3(x * tangent * camera.aspect, y * tangent, -1)
    const stretch = direction.length()
    direction.divideScalar(stretch).applyQuaternion(camera.quaternion)
    return { ray: { origin: { ...pick(camera.position) }, direction: pick(direction) }, stretch }
  }
}

const pick = ({ x, y, z }: Vector3): Place => ({ x, y, z })
