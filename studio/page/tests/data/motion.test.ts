import { describe, expect, it } from 'vitest'
import { legKind, type Motion, motionAt, motionOf, unwrapped } from '../../src/data/world/motion'
import type { Pose } from '../../src/data/world/recorder'
import { Ability } from '../../src/gen/surefoot/world/v1/map_pb'
import { Support } from '../../src/gen/surefoot/world/v1/world_pb'
import type { Place } from '../../src/view/viewport.types'

const at = (x: number): Place => ({ x, y: 0, z: 0 })

const pose = (tick: number, change: Partial<Pose> = {}): Pose => ({
  tick,
  yaw: 0,
  speed: 0,
  support: Support.GROUND,
  ability: Ability.WALK,
  waypoint: undefined,
  ...change,
})

/** Of a body that runs at 10 m/s, on a graph whose edge from 1 to 2 is a jump and from 2 to 3 a zip line. */
const motion = (poses: readonly Pose[]): Motion =>
  motionOf(poses, {
    topSpeed: 10,
    abilityBetween: (from, to) => {
      if (from.x === 1 && to.x === 2) return Ability.JUMP
      return from.x === 2 && to.x === 3 ? Ability.ZIP_LINE : undefined
    },
  })

/** Poses a twentieth of a second apart. */
const every3 = (changes: readonly Partial<Pose>[]): Pose[] =>
  changes.map((change, index) => pose(600 + index * 3, change))

describe('unwrapped', () => {
  const turn = 2 * Math.PI
  it.each([
    ['left past half a turn', [3, -3, -2.8], [3, turn - 3, turn - 2.8]],
    ['right past half a turn', [-3, 3, 2.8], [-3, 3 - turn, 2.8 - turn]],
    ['left twice', [3, -3, 0, 3, -3], [3, turn - 3, turn, turn + 3, 2 * turn - 3]],
    ['nowhere', [], []],
  ])('goes on %s', (_, headings, expected) => {
    expect(unwrapped(headings)).toEqual(expected.map((heading) => expect.closeTo(heading)))
  })
})

describe('motionOf', () => {
  it('begins at the first pose, in seconds', () => {
    const { samples } = motion(every3([{ speed: 1 }, { speed: 2 }, { speed: 3 }]))
    expect(samples.map(({ at, speed }) => [at, speed])).toEqual([
      [0, 1],
      [0.05, 2],
      [0.1, 3],
    ])
  })

  it.each([
    ['idle', { speed: 0.1 }],
    ['walk', { speed: 1.5 }],
    ['jog', { speed: 3 }],
    ['run', { speed: 9 }],
    ['air', { speed: 9, support: Support.AIR }],
    ['ride', { speed: 9, support: Support.ZIP_LINE }],
    ['walk', { speed: 1.5, support: Support.WATER }],
  ])('knows the gait %s', (gait, change) => {
    expect(motion(every3([change, change])).gaits).toEqual([{ from: 0, to: 0.05, gait }])
  })

  it('tells turning in place from standing', () => {
    const { gaits } = motion(every3([{}, {}, { yaw: 0.1 }, { yaw: 0.2 }, { yaw: 0.2 }]))
    expect(gaits.map(({ gait }) => gait)).toEqual(['idle', 'turn', 'idle'])
  })

  it('holds what was while nothing came, since NPCs that do not change send nothing', () => {
    const found = motion([pose(0), pose(120, { yaw: 1, speed: 5 })])
    expect(motionAt(found, 1)).toMatchObject({ heading: 0, speed: 0, gait: 'idle' })
    expect(motionAt(found, 2)).toMatchObject({ heading: 1, speed: 5 })
  })

  it('marks jumps from take-off to landing, and neither steps nor drops', () => {
    const air = { support: Support.AIR }
    const { flights } = motion(every3([{}, air, {}, air, { ...air, ability: Ability.JUMP }, {}, {}]))
    expect(flights).toEqual([{ from: expect.closeTo(0.15), to: expect.closeTo(0.25) }])
  })

  it('has the legs between waypoints, and what edges need', () => {
    const waypoints = [undefined, at(1), at(2), at(2), at(3)]
    const { legs } = motion(every3(waypoints.map((waypoint) => ({ waypoint }))))
    expect(legs.map(({ ability }) => ability)).toEqual([undefined, Ability.JUMP, Ability.ZIP_LINE])
    expect(legs[1]).toMatchObject({ from: expect.closeTo(0.1), to: expect.closeTo(0.2) })
  })

  it('comes back to a leg after the NPC made way for others', () => {
    const waypoints = [at(1), at(2), at(50), at(2), at(50), at(3)]
    const { legs } = motion(every3(waypoints.map((waypoint) => ({ waypoint }))))
    const expected = [undefined, Ability.JUMP, undefined, Ability.JUMP, undefined, Ability.ZIP_LINE]
    expect(legs.map(({ ability }) => ability)).toEqual(expected)
  })
})

describe('motionAt', () => {
  const found = motion(
    every3([
      { speed: 2, waypoint: at(1) },
      { speed: 4, yaw: 1, waypoint: at(2) },
      { speed: 4, yaw: 1 },
    ]),
  )

  it('has values between samples', () => {
    expect(motionAt(found, 0.025)).toMatchObject({
      heading: expect.closeTo(0.5),
      speed: expect.closeTo(3),
      gait: 'jog',
    })
  })

  it.each([
    ['before the start', -1, 2],
    ['after the end', 9, 4],
  ])('has the outermost values %s', (_, seconds, speed) => {
    expect(motionAt(found, seconds).speed).toBe(speed)
  })

  it('has the leg of the moment, if there is one', () => {
    expect(motionAt(found, 0.06).leg?.ability).toBe(Ability.JUMP)
    expect(motionAt(motion(every3([{}, {}])), 0).leg).toBeUndefined()
  })
})

describe('legKind', () => {
  it.each([
    [Ability.WALK, 'walk'],
    [Ability.DOUBLE_JUMP, 'leap'],
    [Ability.PAD, 'device'],
    [Ability.JETPACK, 'device'],
  ])('ability %d is a %s', (ability, kind) => {
    expect(legKind(ability)).toBe(kind)
  })
})
