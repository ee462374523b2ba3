import { create } from '@bufbuild/protobuf'
import { describe, expect, it } from 'vitest'
import { standardSettings } from '../../src/data/build/builds'
import { graphLabel, pickGraph, relativeOf } from '../../src/data/build/graph-list'
import type { Context } from '../../src/data/context'
import { probeInWords, Probes, tally } from '../../src/data/graph/probes'
import { type Placement, ProbeEdgeResponseSchema, ReadyGraphSchema } from '../../src/gen/surefoot/planner/v1/planner_pb'
import { Ability } from '../../src/gen/surefoot/world/v1/map_pb'

const graph = (graphId: string, mapHash: string, seed?: bigint, level = '') =>
  create(ReadyGraphSchema, {
    graphId,
    ...(seed === undefined ? {} : { map: { seed } }),
    level,
    settings: standardSettings(),
    summary: { mapHash, vertices: 300 },
  })

const list = [
  graph('aaaaaaaaaa', 'one', 42n),
  graph('bbbbbbbbbb', 'two', 43n),
  graph('cccccccccc', 'one', 42n),
  graph('dddddddddd', 'three', undefined, 'harbour'),
  graph('eeeeeeeeee', 'four', undefined, 'harbour'),
]

describe('graphs to choose from', () => {
  it('have distinct names', () => {
    expect(list.map(graphLabel).slice(0, 1)).toEqual(['seed 42 · spaced 300 x 12 · aaaaaaaa'])
    expect(graphLabel(list[3]!)).toBe('harbour · spaced 300 x 12 · dddddddd')
    expect(new Set(list.map(graphLabel)).size).toBe(list.length)
  })

  it.each([
    ['aaaaaaaaaa', 'cccccccccc'],
    ['dddddddddd', 'eeeeeeeeee'],
    ['bbbbbbbbbb', 'aaaaaaaaaa'],
  ])('%s is compared with %s', (id, other) => {
    expect(relativeOf(list, id)).toBe(other)
  })

  it.each([
    [['bbbbbbbbbb', 'cccccccccc'], 'bbbbbbbbbb'],
    [['gone', 'cccccccccc'], 'cccccccccc'],
    [['', undefined], 'aaaaaaaaaa'],
  ])('%j wanted picks %s', (wanted, id) => {
    expect(pickGraph(list, wanted)).toBe(id)
  })

  it('may be none', () => {
    expect(pickGraph([], ['x'])).toBe('')
    expect(relativeOf([], 'x')).toBeUndefined()
  })

  it('begin with the settings that workers use', () => {
    const { placement, vertices, neighbours, repeats, threshold } = standardSettings()
    expect([placement satisfies Placement, vertices, neighbours, repeats, threshold]).toEqual([2, 300, 12, 2, 0.2])
  })
})

describe('probes', () => {
  const result = (reached: boolean, decisions: number, ability = Ability.JUMP) =>
    create(ProbeEdgeResponseSchema, { reached, decisions, ability })

  it.each([
    [result(true, 19), 'Arrived after 3.2 s, jumped'],
    [result(true, 3, Ability.ZIP_LINE), 'Arrived after 0.50 s, took a zip line'],
    [result(false, 60), 'Did not arrive within 10 s'],
  ])('%# in words', (probe, words) => {
    expect(probeInWords(probe)).toBe(words)
  })

  it('are tallied by edge and graph', () => {
    const made = [
      { graphId: 'a', from: 1, to: 2, result: result(true, 5), counted: false },
      { graphId: 'a', from: 1, to: 2, result: result(false, 5), counted: true },
      { graphId: 'a', from: 2, to: 1, result: result(true, 5), counted: false },
      { graphId: 'b', from: 1, to: 2, result: result(true, 5), counted: false },
    ]
    expect(tally(made, { graphId: 'a', from: 1, to: 2 })).toEqual({ tries: 2, successes: 1, uncounted: 1 })
    expect(tally(made, { graphId: 'c', from: 1, to: 2 }).tries).toBe(0)
  })

  it('are played until the last of them is over', () => {
    const over: (() => void)[] = []
    // As the view does it: what is played ends when something else is.
    const probes = new Probes({} as Context, (_track, _reached, done) => {
      over.at(-1)?.()
      over.push(done)
    })
    probes.replay(result(true, 5))
    probes.replay(result(true, 5))
    expect(probes.playing.value).toBe(true)
    over.at(-1)?.()
    expect(probes.playing.value).toBe(false)
  })
})
