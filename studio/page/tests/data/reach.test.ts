import { signal } from '@preact/signals'
import { Code, ConnectError, createClient, createRouterTransport } from '@connectrpc/connect'
import { beforeEach, describe, expect, it, vi } from 'vitest'
import type { Context } from '../../src/data/context'
import type { CAUTIONS } from '../../src/data/plan/plans'
import { figuresInWords, MOST_SECONDS, Reach } from '../../src/data/plan/reach'
import {
  type FindReachableRequest,
  type MoverStops,
  PlannerService,
} from '../../src/gen/surefoot/planner/v1/planner_pb'
import { at } from '../view/builders'

const VERTICES = [2, 6, 14].map((seconds, vertex) => ({ vertex, seconds }))
const CELLS = [1, 3, 5, 7, 21].map((seconds) => ({ centre: at(seconds, 0, 1), seconds }))

describe('Reach', () => {
  let requests: FindReachableRequest[]
  /** Cells with smaller sides are too many. */
  let leastSide: number
  let fault: ConnectError | undefined
  const caution = signal<keyof typeof CAUTIONS>('careful')
  const given = signal<readonly MoverStops[]>([])
  let reach: Reach

  const transport = createRouterTransport(({ service }) => {
    service(PlannerService, {
      findReachable: (request) => {
        requests.push(request)
        if (fault !== undefined) throw fault
        if (request.resolution < leastSide) throw new ConnectError('too many cells', Code.OutOfRange)
        return { vertices: VERTICES, cells: CELLS }
      },
    })
  })

  beforeEach(() => {
    ;[requests, leastSide, fault, caution.value] = [[], 0, undefined, 'careful']
    const planner = { calls: createClient(PlannerService, transport) } as Context['planner']
    reach = new Reach({ planner } as Context, caution, given)
  })

  const begin = async () => {
    reach.useGraph('graph')
    reach.setStart(at(1, 2, 3))
    await vi.waitFor(() => expect(reach.state.value).toBe('ready'))
  }

  it('asks once for the longest time, with the caution of plans', async () => {
    caution.value = 'bold'
    await begin()
    expect(requests).toHaveLength(1)
    expect(requests[0]).toMatchObject({ graphId: 'graph', seconds: MOST_SECONDS, resolution: 2 })
    expect(requests[0]?.query).toMatchObject({ start: at(1, 2, 3), caution: 0 })
    expect(requests[0]?.query?.goal).toBeUndefined()
  })

  it.each([
    [1, 0, 4],
    [6, 2, 12],
    [10, 2, 16],
    [30, 3, 20],
  ])('within %d s, reaches %d vertices and %d m2 without another request', async (seconds, vertices, squareMetres) => {
    await begin()
    reach.seconds.value = seconds
    expect(reach.figures.value).toEqual({ vertices, squareMetres, first: 2 })
    expect(reach.area.value).toMatchObject({ side: 2, limit: seconds })
    expect(requests).toHaveLength(1)
  })

  it('takes larger cells where there are too many', async () => {
    leastSide = 8
    await begin()
    expect(requests.map(({ resolution }) => resolution)).toEqual([2, 4, 8])
    expect(reach.area.value?.side).toBe(8)
  })

  it.each([
    ['too many cells of any size', () => (leastSide = 9), 'Too many cells.', 3],
    [
      'a place outside the map',
      () => (fault = new ConnectError('off the map', Code.InvalidArgument)),
      'Off the map.',
      1,
    ],
  ])('says why there is no area: %s', async (_, spoil, words, count) => {
    spoil()
    reach.useGraph('graph')
    reach.setStart(at(1, 2, 3))
    await vi.waitFor(() => expect(reach.state.value).toBe('failed'))
    expect(reach.failure.value).toBe(words)
    expect(reach.figures.value).toBeUndefined()
    expect(requests).toHaveLength(count)
  })

  it('waits for a graph, and follows it and the movers', async () => {
    reach.setStart(at(1, 2, 3))
    expect(reach.state.value).toBe('none')
    expect(requests).toHaveLength(0)
    reach.useGraph('graph')
    await vi.waitFor(() => expect(reach.state.value).toBe('ready'))
    reach.refresh()
    // The area stays until the next one is there.
    expect(reach.state.value).toBe('ready')
    await vi.waitFor(() => expect(requests).toHaveLength(2))
    reach.useGraph(undefined)
    expect(reach.figures.value).toBeUndefined()
  })

  it('shows the place that was clicked last', async () => {
    reach.useGraph('graph')
    reach.setStart(at(1, 0, 0))
    reach.setStart(at(2, 0, 0))
    await vi.waitFor(() => expect(reach.state.value).toBe('ready'))
    expect(reach.area.value?.start.x).toBe(2)
    expect(requests.at(-1)?.query?.start?.x).toBe(2)
  })

  it('forgets all when it is cleared, also what is under way', async () => {
    reach.useGraph('graph')
    reach.setStart(at(1, 0, 0))
    reach.clear()
    await new Promise((resolve) => setTimeout(resolve))
    expect(reach.area.value).toBeUndefined()
    expect(reach.state.value).toBe('none')
  })
})

describe('figuresInWords', () => {
  it.each([
    ['what is reached', { vertices: 50, squareMetres: 1316, first: 1 }, '1,316 m², 25 % of the vertices'],
    ['too little time', { vertices: 0, squareMetres: 0, first: 4 }, 'The nearest edges begin 4.0 s from this place.'],
    [
      'a place far from all edges',
      { vertices: 0, squareMetres: 0, first: undefined },
      'The nearest edges begin more than 30 s from this place.',
    ],
  ])('%s', (_, figures, words) => {
    expect(figuresInWords(figures, 200)).toBe(words)
  })
})
