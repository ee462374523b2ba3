import { create, type MessageInitShape } from '@bufbuild/protobuf'
import { describe, expect, test } from 'vitest'
import { newsOf } from '../../src/data/graph/news'
import { GraphSummarySchema } from '../../src/gen/surefoot/planner/v1/planner_pb'

const summary = (change: Exclude<MessageInitShape<typeof GraphSummarySchema>, { $typeName: string }> = {}) =>
  create(GraphSummarySchema, { probes: 500n, expectedEdges: 40, traversals: 3n, ...change })

describe('a message about a graph', () => {
  const loaded = { summary: summary(), revision: 7n }

  test('that says what is known already is none', () => {
    expect(newsOf(loaded, summary(), 7n)).toBe('none')
  })

  test('of other layers or of a build that went on means another graph', () => {
    expect(newsOf(loaded, summary(), 8n)).toBe('other graph')
    expect(newsOf(loaded, summary({ probes: 900n }), 7n)).toBe('other graph')
    expect(newsOf(loaded, summary({ expectedEdges: 0 }), 7n)).toBe('other graph')
    expect(newsOf(undefined, summary(), 7n)).toBe('other graph')
  })

  test('of more reports means other figures of the same edges', () => {
    expect(newsOf(loaded, summary({ traversals: 4n }), 7n)).toBe('other figures')
  })
})
