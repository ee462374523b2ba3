import { create } from '@bufbuild/protobuf'
import { describe, expect, it } from 'vitest'
import { MoverKind, MoverSchema, MoverStateSchema } from '../../src/gen/surefoot/world/v1/living_pb'
import { Ability } from '../../src/gen/surefoot/world/v1/map_pb'
import { NpcPlanSchema, NpcSchema, NpcStatus } from '../../src/gen/surefoot/world/v1/world_pb'
import { moverNames, npcNames, placeNames, planNames, topOf } from '../../src/data/names'
import { pieceBetween } from '../../src/data/world/pieces'
import type { Features } from '../../src/view/viewport.types'
import { at } from '../view/builders'

const texts = (labels: readonly { text: string }[]) => labels.map(({ text }) => text)

describe('names', () => {
  it('say what kind each device is, and what pieces are called', () => {
    const features: Features = {
      size: { width: 100, height: 80, depth: 100 },
      pools: [{ centre: at(1, 2, 3), halfX: 1, halfZ: 1, round: true, depth: 1, lava: true }],
      pads: [{ centre: at(1, 2, 3), speed: 20 }],
      zipLines: [{ from: at(0, 9, 0), to: at(30, 2, 0) }],
      teleporters: [
        { from: at(0, 0, 0), to: at(9, 0, 9), twoWay: false },
        { from: at(0, 0, 0), to: at(9, 0, 9), twoWay: true },
      ],
      jetpacks: [at(5, 5, 5)],
      spots: [],
    }
    const piece = pieceBetween('block', 'block 1', at(4, 1, 4), at(4, 1, 4), { width: 2, height: 3 })
    expect(texts(placeNames(features, [piece]))).toEqual([
      'Jump pad',
      'Zip line',
      'Teleporter',
      'Teleporter exit',
      'Teleporter',
      'Teleporter',
      'Jetpack',
      'Lava',
      'block 1',
    ])
  })

  it('go along with movers', () => {
    const corners = Float32Array.from([2, 0, 0, 2, 4, 0, 4, 0, 0])
    const positions = new Uint8Array(corners.buffer)
    const [door, gate] = [
      create(MoverSchema, { name: 'door 1', kind: MoverKind.DOOR, positions, pivot: at(2, 0, 0) }),
      create(MoverSchema, { name: 'Gate', kind: MoverKind.DOOR, positions, pivot: at(2, 0, 0) }),
    ]
    expect(topOf(door)).toEqual(at(3, 4, 0))
    const pose = { offset: at(10, 1, 0), yaw: Math.PI / 2, isThere: true }
    const states = new Map([[0, create(MoverStateSchema, { pose })]])
    const [first, second] = moverNames([door, gate], [topOf(door), topOf(gate)], states)
    expect(first).toMatchObject({ text: 'door 1', at: { x: expect.closeTo(12), z: expect.closeTo(-1) } })
    expect(second).toMatchObject({ text: 'Gate (door)', at: { x: 3, z: 0 } })
    const gone = new Map([[0, create(MoverStateSchema, { pose: { ...pose, isThere: false } })]])
    expect(texts(moverNames([door, gate], [topOf(door), topOf(gate)], gone))).toEqual(['Gate (door)'])
  })

  it('say what the selected NPC has to do next', () => {
    const npc = create(NpcSchema, { npcId: 6n, status: NpcStatus.SEEKING, goal: at(30, 0, 0) })
    const plan = create(NpcPlanSchema, {
      waypoints: [at(0, 0, 0), at(10, 0, 0), at(20, 0, 0), at(30, 0, 0)],
      legs: [Ability.WALK, Ability.JUMP, Ability.PAD, Ability.WALK].map((ability) => ({ ability })),
    })
    const followed = { id: 6n, npc, plan, waypointIdx: 1, eyes: undefined, rays: [], history: [] }
    expect(texts(npcNames(followed))).toEqual(['NPC 6', 'Goal', 'Jump', 'Jump pad', 'Walk'])
    expect(npcNames({ ...followed, npc: undefined })).toEqual([])
  })

  it('mark the ends of a plan', () => {
    expect(texts(planNames(at(0, 0, 0), undefined, at(1, 1, 1)))).toEqual(['Start', 'Nearest reachable place'])
  })
})
