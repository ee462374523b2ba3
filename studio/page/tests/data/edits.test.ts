import { create } from '@bufbuild/protobuf'
import { describe, expect, it } from 'vitest'
import { changeInWords, differenceOf } from '../../src/data/edit/difference'
import {
  addVertex,
  describe as inWords,
  editKey,
  forbidEdge,
  forceEdge,
  marksOf,
  moveVertex,
  priceEdge,
  priceEdits,
  removeVertex,
  sameEdit,
  whereIs,
} from '../../src/data/edit/edits'
import { afterRedo, afterUndo, canRedo, canUndo, NOTHING_DONE, type Step, withStep } from '../../src/data/edit/history'
import { type Edit, EditSchema, LayerSchema } from '../../src/gen/surefoot/planner/v1/planner_pb'

const a = { x: 31.2, y: 12, z: 40.4 }
const b = { x: 45, y: -0.2, z: 38 }
const layer = (name: string, ...edits: Edit[]) => create(LayerSchema, { name, edits })

describe('edits in words', () => {
  const forced = create(EditSchema, { edit: { case: 'forceEdge', value: { from: a, to: b, seconds: 3 } } })
  it.each([
    [forbidEdge(a, b), 'Forbid 31, 12, 40 to 45, 0, 38'],
    [forceEdge(a, b), 'Force 31, 12, 40 to 45, 0, 38'],
    [forced, 'Force 31, 12, 40 to 45, 0, 38 (3 s)'],
    [priceEdge(a, b, 2.5), 'Price x 2.5: 31, 12, 40 to 45, 0, 38'],
    [priceEdge(a, b, 0.1), 'Price x 0.1: 31, 12, 40 to 45, 0, 38'],
    [addVertex(a), 'Add vertex at 31, 12, 40'],
    [moveVertex(a, b), 'Move vertex 31, 12, 40 to 45, 0, 38'],
    [removeVertex(b), 'Remove vertex at 45, 0, 38'],
    [create(EditSchema), 'An edit that this page does not know'],
  ])('%#', (edit, words) => {
    expect(inWords(edit)).toBe(words)
  })
})

describe('edits', () => {
  it('are the same after a way over the wire', () => {
    const sent = priceEdge({ x: 0.1, y: 0.2, z: 0.3 }, b, 0.7)
    const received = create(EditSchema, sent)
    expect(sameEdit(sent, received)).toBe(true)
    expect(sent.edit.case === 'priceEdge' && sent.edit.value.from?.x).toBe(Math.fround(0.1))
  })

  it('differ by kind, place and number', () => {
    const keys = [forbidEdge(a, b), forbidEdge(b, a), forceEdge(a, b), priceEdge(a, b, 2), priceEdge(a, b, 3)].map(
      editKey,
    )
    expect(new Set(keys).size).toBe(keys.length)
    expect(sameEdit(forbidEdge(a, b), undefined)).toBe(false)
  })

  it('are somewhere', () => {
    expect(whereIs(forbidEdge({ x: 0, y: 0, z: 0 }, { x: 2, y: 4, z: 6 }))).toEqual({ x: 1, y: 2, z: 3 })
    expect(whereIs(removeVertex({ x: 1, y: 2, z: 3 }))).toMatchObject({ x: 1, y: 2, z: 3 })
  })

  it('leave marks where they took something out, unless they do not fit', () => {
    const layers = [
      layer('day', forbidEdge(a, b), priceEdge(a, b, 2)),
      layer('night', removeVertex(b), removeVertex(a)),
    ]
    const marks = marksOf(layers, (name, index) => name === 'night' && index === 1)
    expect(marks.map(({ kind }) => kind)).toEqual(['forbidden', 'removed'])
  })
})

describe('differenceOf', () => {
  const [one, two, three] = [forbidEdge(a, b), addVertex(a), removeVertex(b)]
  it.each([
    ['nothing', [layer('x', one)], [layer('x', one)], []],
    ['an edit more', [layer('x', one)], [layer('x', one, two)], ['Layer x changed elsewhere: +1 edit']],
    [
      'two more, one less',
      [layer('x', one)],
      [layer('x', two, three)],
      ['Layer x changed elsewhere: +2 edits, -1 edit'],
    ],
    ['one of two equal ones', [layer('x', one, one)], [layer('x', one)], ['Layer x changed elsewhere: -1 edit']],
    ['a new layer', [], [layer('y', one)], ['Layer y was made elsewhere: +1 edit']],
    ['a layer gone', [layer('y', one)], [], ['Layer y was deleted elsewhere']],
    ['another order', [layer('x', one, two)], [layer('x', two, one)], ['Layer x was put in another order elsewhere']],
    [
      'two layers',
      [layer('x', one), layer('y', one)],
      [layer('x', one, two), layer('y')],
      ['Layer x changed elsewhere: +1 edit', 'Layer y changed elsewhere: -1 edit'],
    ],
  ])('%s', (_, before, after, words) => {
    expect(differenceOf(before, after).map(changeInWords)).toEqual(words)
  })
})

describe('priceEdits', () => {
  it.each([
    [1, 2.5, 1],
    [1, 1000, 1],
    [1, 0.1, 1],
    [1000, 1, 3],
    [1000, 0.1, 4],
    [0.1, 1000, 2],
    [20, 0.5, 2],
    [3, 3, 1],
  ])('from x%f to x%f are %i', (present, wanted, parts) => {
    const factors = priceEdits(a, b, present, wanted).map(({ edit }) =>
      edit.case === 'priceEdge' ? edit.value.factor : NaN,
    )
    expect(factors).toHaveLength(parts)
    // As the planner checks them, in single precision.
    for (const factor of factors) expect(factor >= Math.fround(0.1) && factor <= 1000).toBe(true)
    expect(factors.reduce((product, factor) => product * factor, present) / wanted).toBeCloseTo(1, 5)
  })
})

describe('history', () => {
  const step = (edit: Edit): Step => ({ kind: 'append', layer: 'x', edits: [edit] })
  const [one, two] = [forbidEdge(a, b), addVertex(a)]

  it('goes back and forth', () => {
    const done = withStep(withStep(NOTHING_DONE, step(one)), step(two))
    const back = afterUndo(afterUndo(done))
    expect(back.done).toEqual([])
    expect(back.undone).toHaveLength(2)
    expect(afterRedo(afterRedo(back))).toEqual(done)
    expect(afterUndo(NOTHING_DONE)).toEqual(NOTHING_DONE)
  })

  it('forgets what was undone when something new is done', () => {
    const back = afterUndo(withStep(NOTHING_DONE, step(one)))
    expect(withStep(back, step(two)).undone).toEqual([])
  })

  it.each([
    ['is the last', [layer('x', two, one)], true],
    ['is followed by another', [layer('x', one, two)], false],
    ['is gone', [layer('x', two)], false],
    ['was in a layer that is gone', [layer('y', one)], false],
  ])('undoes an edit that %s', (_, layers, can) => {
    expect(canUndo(step(one), layers)).toBe(can)
  })

  it('takes several edits back at once', () => {
    const both: Step = { kind: 'append', layer: 'x', edits: [one, two] }
    expect(canUndo(both, [layer('x', two, one, two)])).toBe(true)
    expect(canUndo(both, [layer('x', two)])).toBe(false)
  })

  it.each([
    ['as it was put', [layer('x', two)], true, false],
    ['as it was before', [layer('x', one)], false, true],
    ['otherwise', [layer('x', two, one)], false, false],
  ])('knows a layer that is %s', (_, layers, undo, redo) => {
    const put: Step = { kind: 'put', layer: 'x', before: [one], after: [two] }
    expect([canUndo(put, layers), canRedo(put, layers)]).toEqual([undo, redo])
  })
})
