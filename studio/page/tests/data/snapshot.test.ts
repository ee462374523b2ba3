import { create } from '@bufbuild/protobuf'
import { describe, expect, it } from 'vitest'
import {
  FollowNpcResponseSchema,
  NpcPlanSchema,
  NpcSchema,
  NpcStatus,
  Outcome,
  Standing,
  WatchWorldResponseSchema,
  WorldStatsSchema,
} from '../../src/gen/surefoot/world/v1/world_pb'
import { Vec3Schema } from '../../src/gen/surefoot/world/v1/map_pb'
import { afterMessage, type Followed } from '../../src/data/world/npcs'
import {
  afterSnapshot,
  countStates,
  findNpcs,
  healthOf,
  type NpcsById,
  npcNumber,
  poseOf,
} from '../../src/data/world/snapshot'

const npc = (npcId: bigint, status = NpcStatus.IDLE, x = 0) => create(NpcSchema, { npcId, status, position: { x } })

const world = (...npcs: ReturnType<typeof npc>[]): NpcsById => new Map(npcs.map((one) => [one.npcId, one]))

describe('afterSnapshot', () => {
  const known = world(npc(1n), npc(2n), npc(3n))

  it('takes a whole snapshot as it is', () => {
    const message = create(WatchWorldResponseSchema, { npcs: [npc(2n)] })
    expect([...afterSnapshot(known, message).keys()]).toEqual([2n])
  })

  it('applies changes to what is known, field by field', () => {
    const sent = create(NpcSchema, {
      ...npc(2n, NpcStatus.SEEKING),
      goal: create(Vec3Schema, { x: 5 }),
      attemptsBegun: 1,
    })
    const changed = [{ npcId: 2n, status: NpcStatus.DOWN, position: { x: 7 }, goalCleared: true }, { npcId: 77n }]
    const message = create(WatchWorldResponseSchema, { isDelta: true, npcs: [npc(9n)], changed })
    const before = world(npc(1n), sent)
    const after = afterSnapshot(before, message)
    expect([...after.keys()]).toEqual([1n, 2n, 9n])
    expect(after.get(2n)).toMatchObject({ status: NpcStatus.DOWN, position: { x: 7 }, attemptsBegun: 1 })
    expect(after.get(2n)?.goal).toBeUndefined()
    expect(before.get(2n)).toMatchObject({ status: NpcStatus.SEEKING, position: { x: 0 }, goal: { x: 5 } })
  })

  it('follows why an NPC stands', () => {
    const change = (standing?: Standing) =>
      create(WatchWorldResponseSchema, { isDelta: true, changed: [{ npcId: 1n, standing }] })
    const stands = afterSnapshot(known, change(Standing.BARRED))
    expect(stands.get(1n)?.standing).toBe(Standing.BARRED)
    expect(afterSnapshot(stands, change()).get(1n)?.standing).toBe(Standing.BARRED)
    expect(afterSnapshot(stands, change(Standing.UNSPECIFIED)).get(1n)?.standing).toBe(Standing.UNSPECIFIED)
  })

  it('takes those away that are gone', () => {
    const message = create(WatchWorldResponseSchema, { isDelta: true, goneNpcIds: [1n, 77n] })
    expect([...afterSnapshot(known, message).keys()]).toEqual([2n, 3n])
  })

  it('changes nothing by an empty change', () => {
    const message = create(WatchWorldResponseSchema, { isDelta: true })
    expect([...afterSnapshot(known, message).values()]).toEqual([...known.values()])
  })
})

describe('what is read from NPCs', () => {
  it('counts them by state', () => {
    const npcs = world(npc(1n, NpcStatus.SEEKING), npc(2n, NpcStatus.DOWN), npc(3n, NpcStatus.SEEKING), npc(4n))
    expect(countStates(npcs)).toEqual({ idle: 1, seeking: 2, down: 1 })
  })

  it('numbers them within their world', () => {
    expect(npcNumber(4294967297n)).toBe('1')
    expect(npcNumber(2n * 4294967296n + 15n)).toBe('15')
  })

  it.each([
    ['', ['1', '2', '12']],
    ['1', ['1', '12']],
    ['12', ['12']],
    ['down', ['2']],
    [' SEEK ', ['12']],
    ['99', []],
  ])('finds by %j', (text, numbers) => {
    const npcs = world(npc(12n, NpcStatus.SEEKING), npc(2n, NpcStatus.DOWN), npc(1n))
    expect(findNpcs(npcs, text).map(({ npcId }) => npcNumber(npcId))).toEqual(numbers)
  })

  it('has a pose even for an NPC without a place', () => {
    expect(poseOf(create(NpcSchema, { npcId: 5n }))).toMatchObject({
      id: 5n,
      state: 'idle',
      position: { x: 0, y: 0, z: 0 },
    })
  })
})

describe('healthOf', () => {
  const at = (atMs: number, answered: bigint, missed: bigint, reached = 0n, fell = 0n) => ({
    atMs,
    stats: create(WorldStatsSchema, { decisionsAnswered: answered, decisionsMissed: missed, reached, fell }),
  })

  it.each([
    ['nothing', [], undefined, undefined, undefined],
    ['one sample', [at(0, 10n, 0n, 3n, 1n)], undefined, undefined, 0.75],
    ['two samples', [at(0, 100n, 0n), at(2000, 280n, 20n)], 90, 0.9, undefined],
    ['a world at rest', [at(0, 100n, 5n, 1n), at(2000, 100n, 5n, 1n)], 0, undefined, 1],
  ])('of %s', (_, samples, decisionsPerSecond, inTime, success) => {
    expect(healthOf(samples)).toMatchObject({ decisionsPerSecond, inTime, success })
  })
})

describe('afterMessage', () => {
  const plan = create(NpcPlanSchema, { waypoints: [{ x: 1 }] })
  const known: Followed = {
    id: 1n,
    npc: npc(1n),
    plan,
    waypointIdx: 0,
    eyes: undefined,
    rays: [],
    history: create(FollowNpcResponseSchema, { history: [{ attempt: 1, outcome: Outcome.REACHED }] }).history,
  }

  it('keeps plan and history that were not sent', () => {
    const after = afterMessage(known, create(FollowNpcResponseSchema, { waypointIdx: 3, npc: npc(1n) }))
    expect(after.plan).toBe(plan)
    expect(after.history).toHaveLength(1)
    expect(after.waypointIdx).toBe(3)
  })

  it.each<[string, object, object | undefined, number]>([
    ['a waypoint of its plan', { x: 1 }, undefined, 1],
    ['a point off its plan', { x: 7 }, undefined, 0],
    ['a point off a new plan', { x: 7 }, { waypoints: [{ x: 5 }, { x: 6 }] }, 0],
    ['a waypoint of a new plan', { x: 6 }, { waypoints: [{ x: 5 }, { x: 6 }] }, 1],
  ])('says which leg an NPC is on while it heads for %s', (_, waypoint, plan, expected) => {
    const two = create(NpcPlanSchema, { waypoints: [{ x: 0 }, { x: 1 }] })
    const message = { waypointIdx: 1, npc: { npcId: 1n, goal: { x: 9 }, waypoint }, ...(plan ? { plan } : {}) }
    const after = afterMessage({ ...known, plan: two }, create(FollowNpcResponseSchema, message))
    expect(after.waypointIdx).toBe(expected)
  })

  it('takes a plan without waypoints for no plan', () => {
    const after = afterMessage(known, create(FollowNpcResponseSchema, { plan: {} }))
    expect(after.plan?.waypoints).toEqual([])
  })

  it('takes a history in place of the one before', () => {
    const history = [
      { attempt: 1, outcome: Outcome.REACHED },
      { attempt: 2, outcome: Outcome.FELL },
    ]
    expect(afterMessage(known, create(FollowNpcResponseSchema, { history })).history).toHaveLength(2)
  })
})
