import { create } from '@bufbuild/protobuf'
import { describe, expect, it } from 'vitest'
import { type Npc, NpcSchema, NpcStatus } from '../../src/gen/surefoot/world/v1/world_pb'
import { npcAfter, npcToOpenOn } from '../../src/data/world/under-way'

const at = (x: number) => ({ x, y: 0, z: 0 })
const idle = (id: number): Npc => create(NpcSchema, { npcId: BigInt(id), position: at(0), status: NpcStatus.IDLE })
const seeking = (id: number, goal: number, waypoint?: number): Npc =>
  create(NpcSchema, {
    npcId: BigInt(id),
    position: at(0),
    status: NpcStatus.SEEKING,
    goal: at(goal),
    ...(waypoint === undefined ? {} : { waypoint: at(waypoint) }),
  })
const world = (...npcs: Npc[]) => new Map(npcs.map((npc) => [npc.npcId, npc]))

describe('npcToOpenOn', () => {
  it.each<[string, Npc[], bigint | undefined]>([
    ['nothing on an empty map', [], undefined],
    ['nothing while all are idle', [idle(1), idle(2)], undefined],
    ['the one with the farthest goal', [idle(1), seeking(2, 30), seeking(3, 80), seeking(4, 50)], 3n],
    ['one with a plan before one without', [seeking(1, 200), seeking(2, 30, 5), seeking(3, 60, 5)], 3n],
  ])('is %s', (_, npcs, expected) => {
    expect(npcToOpenOn(world(...npcs))?.npcId).toBe(expected)
  })
})

describe('npcAfter', () => {
  const crowd = world(seeking(5, 10, 1), idle(1), seeking(3, 10, 1), seeking(9, 10))
  it.each<[bigint | undefined, bigint]>([
    [undefined, 3n],
    [3n, 5n],
    [4n, 5n],
    [5n, 3n],
  ])('goes from one with a plan to the next: after %s', (id, expected) => {
    expect(npcAfter(crowd, id)?.npcId).toBe(expected)
  })

  it('takes any NPC where none is under way', () => {
    expect(npcAfter(world(idle(1), idle(2)), 1n)?.npcId).toBe(2n)
    expect(npcAfter(world(), 1n)).toBeUndefined()
  })
})
