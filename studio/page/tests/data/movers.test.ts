import { create } from '@bufbuild/protobuf'
import { describe, expect, it } from 'vitest'
import { GetGraphResponseSchema } from '../../src/gen/surefoot/planner/v1/planner_pb'
import { MoverKind, MoverSchema, MoverStateSchema } from '../../src/gen/surefoot/world/v1/living_pb'
import { afterStates, doing, lostWithout, onClick, stopsAhead } from '../../src/data/world/movers'

const state = (mover: number, fromStop: number, toStop = fromStop) =>
  create(MoverStateSchema, { mover, fromStop, toStop, toldStop: toStop, pace: 1 })

describe('afterStates', () => {
  it('takes all states, or those that have changed', () => {
    const all = afterStates(new Map(), [state(0, 0), state(1, 0)], false)
    const changed = afterStates(all, [state(1, 0, 1)], true)
    expect([...changed].map(([index, { toStop }]) => [index, toStop])).toEqual([
      [0, 0],
      [1, 1],
    ])
    expect(afterStates(changed, [], true)).toBe(changed)
    expect(afterStates(changed, [state(4, 0)], false).size).toBe(1)
  })
})

describe('doing', () => {
  it('says what a door does', () => {
    const words = [state(0, 0), state(0, 1), state(0, 0, 1), state(0, 1, 0)].map((it) => doing(MoverKind.DOOR, it))
    expect(words).toEqual(['shut', 'open', 'opens', 'shuts'])
  })

  it('says what holds a lift up', () => {
    const held = create(MoverStateSchema, { ...state(0, 0, 1), blocked: true })
    expect(doing(MoverKind.LIFT, held)).toBe('to stop 2, held up')
    expect(doing(MoverKind.LIFT, create(MoverStateSchema, { ...state(0, 1), pace: 0 }))).toBe('at stop 2, halted')
    expect(doing(MoverKind.LIFT, undefined)).toBe('')
  })

  it('says where a crate lies', () => {
    const at = (x: number, isThere: boolean, pace = 1) =>
      create(MoverStateSchema, { pace, pose: { offset: { x }, isThere } })
    const words = [at(0, true), at(3, true), at(3, true, 0), at(3, false)].map((it) => doing(MoverKind.CRATE, it))
    expect(words).toEqual(['in its place', '3.0 m from its place', '3.0 m from its place, held', 'fell off the map'])
  })
})

describe('stopsAhead', () => {
  const mover = (kind: MoverKind) => create(MoverSchema, { kind, stops: [{}, {}] })

  it('knows where a door stays, and that a lift comes when it is called', () => {
    expect(stopsAhead(mover(MoverKind.DOOR), state(0, 0, 1), false)).toBe(2)
    expect(stopsAhead(mover(MoverKind.LIFT), state(0, 0, 1), false)).toBeUndefined()
    expect(stopsAhead(mover(MoverKind.LIFT), state(0, 0, 1), true)).toBe(1)
    const cycling = create(MoverStateSchema, { mover: 0 })
    expect(stopsAhead(mover(MoverKind.DOOR), cycling, false)).toBeUndefined()
  })
})

describe('onClick', () => {
  const mover = (kind: MoverKind, stops: number) =>
    create(MoverSchema, { kind, stops: Array.from({ length: stops }, () => ({})) })

  it('opens and shuts doors, and sends lifts to their next stop', () => {
    expect(onClick(mover(MoverKind.DOOR, 2), state(0, 0))).toEqual({ case: 'open', value: true })
    expect(onClick(mover(MoverKind.DOOR, 2), state(0, 0, 1))).toEqual({ case: 'open', value: false })
    expect(onClick(mover(MoverKind.FLOOR, 2), state(0, 0))).toEqual({ case: 'open', value: false })
    expect(onClick(mover(MoverKind.LIFT, 3), state(0, 1))).toEqual({ case: 'stop', value: 2 })
    expect(onClick(mover(MoverKind.LIFT, 3), state(0, 2))).toEqual({ case: 'stop', value: 0 })
    expect(onClick(mover(MoverKind.LIFT, 3), undefined)).toEqual({ case: 'stop', value: 1 })
    expect(onClick(mover(MoverKind.CONVEYOR, 1), state(0, 0))).toBeUndefined()
    expect(onClick(mover(MoverKind.CRATE, 1), state(0, 0))).toEqual({ case: 'stop', value: 0 })
  })
})

describe('lostWithout', () => {
  // 0 <-> 1 through a door, 1 <-> 2 by a ride.
  const graph = create(GetGraphResponseSchema, {
    vertices: [{ x: 0 }, { x: 1 }, { x: 2 }],
    islands: [0, 0, 0],
    edges: [
      { from: 0, to: 1, needs: [{ mover: 0, stops: 2 }] },
      { from: 1, to: 0, needs: [{ mover: 0, stops: 2 }] },
      { from: 1, to: 2, needs: [{ mover: 1, stops: 1 }], ride: { mover: 1, fromStop: 0, toStop: 1 } },
      { from: 2, to: 1, needs: [{ mover: 1, stops: 2 }], ride: { mover: 1, fromStop: 1, toStop: 0 } },
    ],
  })
  const lost = (mover: number, stops: number) =>
    lostWithout(graph, [{ $typeName: 'surefoot.planner.v1.MoverStops', mover, stops }]).map(({ x }) => x)

  it('finds what lies behind a locked door', () => {
    expect(lost(0, 1)).toEqual([1, 2])
    expect(lost(0, 3)).toEqual([])
  })

  it('finds what only a lift leads to', () => {
    expect(lost(1, 1)).toEqual([2])
  })

  it('loses nothing on an empty graph', () => {
    expect(lostWithout(create(GetGraphResponseSchema, {}), [])).toEqual([])
  })
})
