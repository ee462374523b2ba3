import { describe, expect, it } from 'vitest'
import {
  approach,
  copyPose,
  fitBox,
  lensOf,
  metresPerPixel,
  type OrbitPose,
  pan,
  rotate,
  zoom,
} from '../../src/view/orbit'
import { PictureCounter, ResolutionGovernor } from '../../src/view/quality'
import { trackAt } from '../../src/view/track'
import { at } from './builders'

const side = (): OrbitPose => ({ target: at(10, 2, 10), distance: 100, azimuth: 0.6, polar: 0.9, flat: 0 })
const top = (): OrbitPose => ({ ...side(), azimuth: 0, polar: 0, flat: 1 })

describe('orbit', () => {
  it('stands south of the target and above it, and looks north', () => {
    const { eye } = lensOf({ ...side(), azimuth: 0 }, 300)
    expect(eye.x).toBeCloseTo(10, 6)
    expect(eye.z).toBeGreaterThan(10)
    expect(Math.hypot(eye.y - 2, eye.z - 10)).toBeCloseTo(100, 6)
  })

  it('shows as much from the top through its narrow lens', () => {
    const { eye, fieldOfView } = lensOf(top(), 300)
    const seen = 2 * (eye.y - 2) * Math.tan(fieldOfView / 2)
    expect(seen).toBeCloseTo(720 * metresPerPixel(side(), 720), 3)
    expect(lensOf(top(), 300).near).toBeLessThan(eye.y - 300)
  })

  it.each([
    ['turns and tilts', side(), -0.2],
    ['turns only from the top', top(), 0],
  ])('%s', (_, pose, tilt) => {
    const before = copyPose(pose)
    rotate(pose, 72, 144 * 0.3183098, 720)
    expect(pose.azimuth - before.azimuth).toBeCloseTo(-Math.PI / 10, 6)
    expect(pose.polar - before.polar).toBeCloseTo(tilt, 3)
  })

  it('does not go below the ground nor over the top', () => {
    const pose = side()
    rotate(pose, 0, -9000, 720)
    expect(pose.polar).toBeLessThan(Math.PI / 2)
    rotate(pose, 0, 9000, 720)
    expect(pose.polar).toBeGreaterThan(0)
  })

  it('draws the map along with the pointer', () => {
    const pose = { ...top(), target: at(0, 0, 0) }
    pan(pose, 10, 20, 720)
    const step = metresPerPixel(pose, 720)
    expect(pose.target.x).toBeCloseTo(-10 * step, 6)
    expect(pose.target.z).toBeCloseTo(-20 * step, 6)
  })

  it('zooms towards a place, which stays where it is in the picture', () => {
    const pose = side()
    const place = at(40, 5, -10)
    const before = lensOf(pose, 300).eye
    zoom(pose, 0.5, place)
    const after = lensOf(pose, 300).eye
    for (const axis of ['x', 'y', 'z'] as const) {
      expect(after[axis] - place[axis]).toBeCloseTo((before[axis] - place[axis]) / 2, 6)
    }
  })

  it.each([
    ['from the side', side(), 16 / 9],
    ['from the side on a phone', side(), 9 / 19],
    ['from the top', top(), 16 / 9],
  ])('frames a box %s', (_, pose, aspect) => {
    const [low, high] = [at(0, 0, 0), at(250, 50, 250)]
    const fitted = { ...pose, ...fitBox(pose, low, high, aspect) }
    const { eye, fieldOfView } = lensOf(fitted, 350)
    const tangent = Math.tan(fieldOfView / 2)
    let largest = 0
    for (let corner = 0; corner < 8; corner += 1) {
      const x = (corner & 1 ? 250 : 0) - eye.x
      const y = (corner & 2 ? 50 : 0) - eye.y
      const z = (corner & 4 ? 250 : 0) - eye.z
      const [sin, cos] = [Math.sin(pose.azimuth), Math.cos(pose.azimuth)]
      const outward = x * sin + z * cos
      const depth = -(y * Math.cos(pose.polar) + outward * Math.sin(pose.polar))
      largest = Math.max(
        largest,
        Math.abs(x * cos - z * sin) / depth / tangent / aspect,
        Math.abs(y * Math.sin(pose.polar) - outward * Math.cos(pose.polar)) / depth / tangent,
      )
    }
    expect(largest).toBeLessThan(1.001)
    expect(largest).toBeGreaterThan(0.85)
  })

  it('comes to where it is going and then stops', () => {
    const [shown, goal] = [side(), top()]
    let steps = 0
    while (approach(shown, goal, 16, 200) && steps < 500) {
      steps += 1
    }
    expect(steps).toBeGreaterThan(20)
    expect(shown).toEqual(goal)
  })

  it('jumps there if there is to be no motion', () => {
    const [shown, goal] = [side(), top()]
    approach(shown, goal, 16, 0)
    expect(approach(shown, goal, 16, 0)).toBe(false)
    expect(shown).toEqual(goal)
  })
})

describe('ResolutionGovernor', () => {
  const run = (governor: ResolutionGovernor, pictures: number, msOf: (share: number) => number): number => {
    for (let picture = 0; picture < pictures; picture += 1) {
      governor.add(msOf(governor.share))
    }
    return governor.share
  }

  it.each([
    ['quick pictures', () => 16, 1],
    ['pictures that take as long as their pixels', (share: number) => 70 * share * share, 0.64],
    ['pictures that fewer pixels do not help', () => 90, 1],
  ])('%s', (_, msOf, expected) => {
    expect(run(new ResolutionGovernor(34, 0.5), 120, msOf)).toBe(expected)
  })

  it('keeps to its least share', () => {
    expect(run(new ResolutionGovernor(34, 0.8), 400, (share) => 200 * share * share)).toBe(0.8)
  })

  it('comes back once pictures are quick', () => {
    const governor = new ResolutionGovernor(34, 0.5)
    expect(run(governor, 60, (share) => 70 * share * share)).toBeLessThan(1)
    expect(run(governor, 2000, () => 10)).toBe(1)
  })
})

describe('PictureCounter', () => {
  it('counts those of the last second and what they cost', () => {
    const counter = new PictureCounter()
    for (let now = 0; now <= 2000; now += 25) {
      counter.add(now, now < 1500 ? 2 : 4)
    }
    expect(counter.pace(2000)).toEqual({ framesPerSecond: 40, millisecondsPerFrame: (19 * 2 + 21 * 4) / 40 })
    expect(counter.pace(2500)).toEqual({ framesPerSecond: 20, millisecondsPerFrame: 4 })
    expect(counter.pace(9000)).toEqual({ framesPerSecond: 0, millisecondsPerFrame: 0 })
  })
})

describe('trackAt', () => {
  const track = Float32Array.from({ length: 61 * 3 }, (_, index) => (index % 3 === 0 ? index / 3 / 10 : 0))

  it.each([
    ['at the start', 0, 0],
    ['between two ticks', 0.025, 0.15],
    ['after a second', 1, 6],
    ['after its end', 99, 6],
  ])('%s', (_, seconds, x) => {
    const { at: place, yaw } = trackAt(track, seconds)
    expect(place.x).toBeCloseTo(x, 4)
    expect(yaw).toBeCloseTo(Math.PI / 2, 4)
  })
})
