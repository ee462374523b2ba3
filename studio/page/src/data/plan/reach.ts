// The area tool: what an NPC reaches from a place within some seconds.

import { Code, ConnectError } from '@connectrpc/connect'
import { batch, computed, type ReadonlySignal, signal } from '@preact/signals'
import type { MoverStops, ReachedVertex } from '../../gen/surefoot/planner/v1/planner_pb'
import type { Place, ReachArea, ReachCell } from '../../view/viewport.types'
import type { Context } from '../context'
import { count, duration, percent } from '../format'
import { failureOf, inWords } from '../net/errors'
import { CAUTIONS } from './plans'

/**
 * The longest time to choose, s. The page asks the planner for all of it at once: what is reached within less time is
 * a part of that, with the same seconds, so another time needs no request.
 */
export const MOST_SECONDS = 30
/** Sides of cells, m. The next one is for areas that have too many cells with this one. */
const SIDES_M = [2, 4, 8] as const
/** One list, so that the view lays it on the ground once. */
const NO_CELLS: readonly ReachCell[] = []

/** What is reached within `MOST_SECONDS`. */
interface Reached {
  side: number
  vertices: readonly Pick<ReachedVertex, 'vertex' | 'seconds'>[]
  cells: readonly ReachCell[]
}

/** What is reached within the chosen seconds, in numbers. */
export interface ReachFigures {
  vertices: number
  /** Ground of all storeys, m2. */
  squareMetres: number
  /** When an NPC reaches its first vertex, s; undefined: it reaches none within `MOST_SECONDS`. */
  first: number | undefined
}

/** "1,316 m², 42 % of the vertices", or why nothing is reached. `vertexCount`: all vertices of the graph. */
export function figuresInWords({ vertices, squareMetres, first }: ReachFigures, vertexCount: number): string {
  if (first === undefined) return `The nearest edges begin more than ${MOST_SECONDS} s from this place.`
  if (vertices === 0) return `The nearest edges begin ${duration(first)} from this place.`
  return `${count(squareMetres)} m², ${percent(vertices / vertexCount)} of the vertices`
}

export class Reach {
  readonly start = signal<Place | undefined>(undefined)
  readonly seconds = signal(10)
  readonly state = signal<'none' | 'asking' | 'ready' | 'failed'>('none')
  readonly failure = signal('')
  private readonly reached = signal<Reached | undefined>(undefined)
  readonly figures = computed<ReachFigures | undefined>(() => {
    const [reached, limit] = [this.reached.value, this.seconds.value]
    if (reached === undefined) return undefined
    const countWithin = (list: readonly { seconds: number }[]) => list.filter(({ seconds }) => seconds <= limit).length
    const first = reached.vertices.reduce((least, { seconds }) => Math.min(least, seconds), Infinity)
    return {
      vertices: countWithin(reached.vertices),
      squareMetres: countWithin(reached.cells) * reached.side ** 2,
      first: Number.isFinite(first) ? first : undefined,
    }
  })
  readonly area = computed<ReachArea | undefined>(() => {
    const [start, reached] = [this.start.value, this.reached.value]
    if (start === undefined) return undefined
    const { side, cells } = reached ?? { side: SIDES_M[0], cells: NO_CELLS }
    return { start, side, cells, limit: this.seconds.value }
  })
  private running: AbortController | undefined
  private graphId: string | undefined

  /** `caution` and `given`: those of plans. */
  constructor(
    private readonly context: Context,
    private readonly caution: ReadonlySignal<keyof typeof CAUTIONS>,
    private readonly given: ReadonlySignal<readonly MoverStops[]>,
  ) {}

  /** Starts from another place. */
  setStart(at: Place): void {
    batch(() => {
      this.start.value = at
      this.reached.value = undefined
    })
    void this.ask()
  }

  /** Asks again, because movers have moved or the caution has changed. */
  refresh(): void {
    void this.ask()
  }

  /** Asks again on another or a changed graph. */
  useGraph(graphId: string | undefined): void {
    if (graphId !== this.graphId) this.reached.value = undefined
    this.graphId = graphId
    void this.ask()
  }

  clear(): void {
    this.running?.abort()
    batch(() => {
      this.start.value = undefined
      this.reached.value = undefined
      this.state.value = 'none'
    })
  }

  private async ask(): Promise<void> {
    this.running?.abort()
    const [graphId, start] = [this.graphId, this.start.peek()]
    if (graphId === undefined || start === undefined) {
      this.state.value = 'none'
      return
    }
    const { signal } = (this.running = new AbortController())
    // What is shown stays until the answer comes.
    if (this.reached.peek() === undefined) this.state.value = 'asking'
    try {
      const reached = await this.find(graphId, start, signal)
      if (signal.aborted) return
      batch(() => {
        this.reached.value = reached
        this.state.value = 'ready'
      })
    } catch (error) {
      if (signal.aborted || failureOf(error) === 'cancelled') return
      batch(() => {
        this.reached.value = undefined
        this.state.value = 'failed'
        this.failure.value = inWords(error)
      })
    }
  }

  private async find(graphId: string, start: Place, signal: AbortSignal, step = 0): Promise<Reached> {
    const side = SIDES_M[step] ?? SIDES_M[0]
    const query = { start, caution: CAUTIONS[this.caution.peek()], movers: [...this.given.peek()] }
    const request = { graphId, query, seconds: MOST_SECONDS, resolution: side }
    try {
      const { vertices, cells } = await this.context.planner.calls.findReachable(request, { signal })
      return {
        side,
        vertices,
        cells: cells.flatMap(({ centre, seconds }) => (centre === undefined ? [] : [{ centre, seconds }])),
      }
    } catch (error) {
      const isTooLarge = ConnectError.from(error).code === Code.OutOfRange
      if (!isTooLarge || step + 1 >= SIDES_M.length) throw error
      return this.find(graphId, start, signal, step + 1)
    }
  }
}
