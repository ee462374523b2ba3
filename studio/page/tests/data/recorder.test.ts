import { create } from '@bufbuild/protobuf'
import { describe, expect, it } from 'vitest'
import {
  AttemptEndedSchema,
  type Npc,
  NpcSchema,
  NpcStatus,
  Outcome,
  Support,
} from '../../src/gen/surefoot/world/v1/world_pb'
import { Ability } from '../../src/gen/surefoot/world/v1/map_pb'
import { Recorder } from '../../src/data/world/recorder'
import { Replays } from '../../src/data/world/replays'

const npc = (id: number, x: number, attempt: number, status = NpcStatus.SEEKING): Npc =>
  create(NpcSchema, { npcId: BigInt(id), position: { x, y: 1, z: 0 }, attemptsBegun: attempt, status })

const xs = (track: Float32Array): number[] => [...track].filter((_, index) => index % 3 === 0)

describe('Recorder', () => {
  it('has a position for each tick of an attempt, between those that came', () => {
    const recorder = new Recorder()
    recorder.take(0, npc(1, 50, 0, NpcStatus.IDLE))
    recorder.take(3, npc(1, 0, 1))
    recorder.take(3, npc(2, 90, 1))
    recorder.take(6, npc(1, 3, 1))
    recorder.take(8, npc(1, 4, 1))
    const attempt = recorder.attempt(1n, 1)!
    expect(xs(attempt.track)).toEqual([0, 1, 2, 3, 3.5, 4])
    expect(attempt.isCut).toBe(false)
  })

  it('tells attempts apart, and says which of them began before it listened', () => {
    const recorder = new Recorder()
    const ticks = [0, 3, 6, 9].map((tick) => [tick, npc(1, tick, tick < 6 ? 4 : 5)] as const)
    for (const [tick, pose] of ticks) recorder.take(tick, pose)
    expect(xs(recorder.attempt(1n, 4)!.track).at(-1)).toBe(3)
    expect(recorder.attempt(1n, 4)!.isCut).toBe(true)
    expect(xs(recorder.attempt(1n, 5)!.track)).toEqual([6, 7, 8, 9])
    expect(recorder.attempt(1n, 5)!.isCut).toBe(false)
  })

  it('keeps how the NPC moved, where something came', () => {
    const recorder = new Recorder()
    const moved = { velocity: { x: 3, y: 9, z: 4 }, waypoint: { x: 7, y: 8, z: 9 }, yaw: 0.5 }
    const [support, ability] = [Support.AIR, Ability.JUMP]
    const about = { npcId: 1n, position: { x: 0, y: 1, z: 0 }, attemptsBegun: 1, status: NpcStatus.SEEKING }
    recorder.take(0, create(NpcSchema, { ...about, ...moved, support, ability }))
    recorder.take(6, npc(1, 1, 1))
    expect(recorder.attempt(1n, 1)!.poses).toEqual([
      { tick: 0, yaw: 0.5, speed: 5, support, ability, waypoint: moved.waypoint },
      { tick: 6, yaw: 0, speed: 0, support: 0, ability: 0, waypoint: undefined },
    ])
  })

  it.each([
    ['another NPC', 2n, 1],
    ['an attempt that has not begun', 1n, 9],
    ['no attempt', 1n, 0],
  ])('has nothing of %s', (_, id, attempt) => {
    const recorder = new Recorder()
    recorder.take(0, npc(1, 0, 1))
    recorder.take(3, npc(1, 1, 1))
    expect(recorder.attempt(id, attempt)).toBeUndefined()
  })

  it('ends soon after the attempt, though the NPC stays where it is', () => {
    const recorder = new Recorder()
    for (let tick = 0; tick < 60; tick += 3) recorder.take(tick, npc(1, tick / 30, 1))
    for (let tick = 60; tick < 900; tick += 3) recorder.take(tick, npc(1, 2, 1, NpcStatus.DOWN))
    expect(recorder.attempt(1n, 1)!.track.length / 3).toBe(60 + 45 + 1)
  })

  it('draws no way to where an NPC was put', () => {
    const recorder = new Recorder()
    recorder.take(0, npc(1, 0, 1))
    recorder.take(4, npc(1, 40, 1))
    expect(xs(recorder.attempt(1n, 1)!.track)).toEqual([0, 0, 0, 0, 40])
  })

  it('overwrites the oldest poses, and forgets a world that began again', () => {
    const recorder = new Recorder(8)
    for (let tick = 0; tick < 60; tick += 3) recorder.take(tick, npc(1, tick, 1))
    expect(xs(recorder.attempt(1n, 1)!.track)[0]).toBe(36)
    recorder.take(3, npc(1, 7, 1))
    expect(recorder.attempt(1n, 1)).toBeUndefined()
  })
})

describe('Replays', () => {
  const ended = (attempt: number, outcome: Outcome) => create(AttemptEndedSchema, { attempt, outcome })
  const recorded = (attempts: readonly number[]) => {
    const recorder = new Recorder()
    for (const attempt of attempts) {
      for (let tick = 0; tick <= 120; tick += 3) recorder.take(attempt * 1000 + tick, npc(1, tick / 30, attempt))
    }
    return new Replays(recorder, () => ({ topSpeed: 10, abilityBetween: () => undefined }))
  }

  it('plays the last attempt that has ended, from its start to its end', () => {
    const replays = recorded([1, 2, 3])
    expect(replays.open(1n, 3, [ended(1, Outcome.REACHED), ended(2, Outcome.FELL)])).toBe(true)
    expect(replays.shown.value).toMatchObject({ attempt: 2, outcome: Outcome.FELL })
    expect(replays.length.value).toBe(2)
    replays.advance(1.5)
    expect([replays.seconds.value, replays.playing.value]).toEqual([1.5, true])
    replays.advance(1.5)
    expect([replays.seconds.value, replays.playing.value]).toEqual([2, false])
    replays.toggle()
    expect([replays.seconds.value, replays.playing.value]).toEqual([0, true])
  })

  it.each([
    ['an earlier one where the last was not received', [1, 3], [ended(1, Outcome.REACHED), ended(2, Outcome.FELL)], 1],
    ['the present one where no other was received', [3], [ended(2, Outcome.FELL)], 3],
  ])('plays %s', (_, attempts, history, expected) => {
    const replays = recorded(attempts)
    expect(replays.open(1n, 3, history)).toBe(true)
    expect(replays.shown.value?.attempt).toBe(expected)
  })

  it('has nothing to play where nothing was received', () => {
    expect(recorded([]).open(1n, 3, [ended(2, Outcome.FELL)])).toBe(false)
  })

  it('stops where it is sought, within the attempt', () => {
    const replays = recorded([1])
    replays.open(1n, 1, [])
    replays.seek(0.5)
    replays.advance(1)
    expect([replays.seconds.value, replays.playing.value]).toEqual([0.5, false])
    replays.seek(99)
    expect(replays.seconds.value).toBe(2)
    replays.close()
    replays.toggle()
    expect([replays.shown.value, replays.playing.value]).toEqual([undefined, false])
  })
})
