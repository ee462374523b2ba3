import { describe, expect, it } from 'vitest'
import { chooseLabels, type PlacedLabel } from '../../src/view/label-layout'

const label = (key: string, left: number, changes: Partial<PlacedLabel> = {}): PlacedLabel => ({
  key,
  left,
  top: 0,
  width: 50,
  height: 20,
  rank: 3,
  depth: 10,
  ...changes,
})
const keys = (labels: readonly PlacedLabel[]) => labels.map(({ key }) => key)
const all = () => true

describe('chooseLabels', () => {
  it.each<[string, PlacedLabel[], string[], string[]]>([
    ['all where there is room', [label('a', 0), label('b', 60)], [], ['a', 'b']],
    ['the nearer of two that overlap', [label('a', 0), label('b', 40, { depth: 5 })], [], ['b']],
    ['the lower rank before the nearer', [label('a', 0, { rank: 1, depth: 90 }), label('b', 40)], [], ['a']],
    ['the one that was shown', [label('a', 0, { depth: 12 }), label('b', 40)], ['a'], ['a']],
    ['none so near that they touch', [label('a', 0), label('b', 51)], [], ['a']],
    ['one above the other', [label('a', 0), label('b', 0, { top: 30 })], [], ['a', 'b']],
  ])('shows %s', (_, labels, shown, expected) => {
    expect(keys(chooseLabels(labels, new Set(shown), 9, all))).toEqual(expected)
  })

  it('shows no more than there may be, and gives the room of what is hidden to others', () => {
    const row = Array.from({ length: 9 }, (_, at) => label(`${at}`, at * 100, { depth: at }))
    expect(keys(chooseLabels(row, new Set(), 3, all))).toEqual(['0', '1', '2'])
    const pair = [label('a', 0), label('b', 40, { depth: 20 })]
    expect(keys(chooseLabels(pair, new Set(), 9, ({ key }) => key !== 'a'))).toEqual(['b'])
  })
})
