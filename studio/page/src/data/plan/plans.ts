// The plan tool: from where, to where, and the ways that there are.

import { batch, computed, type ReadonlySignal, signal } from '@preact/signals'
import type { MoverStops, PathQuery, Plan } from '../../gen/surefoot/planner/v1/planner_pb'
import type { PathLine, Place } from '../../view/viewport.types'
import type { Context } from '../context'
import { failureOf, inWords } from '../net/errors'
import { alternativeQueries, legKey, pickAlternatives } from './alternatives'

/** How much plans do to avoid deaths, as `PathQuery.caution`. */
export const CAUTIONS = { careful: 1, bold: 0 }

export type PlanState = 'none' | 'asking' | 'ready' | 'failed'

export class Plans {
  readonly start = signal<Place | undefined>(undefined)
  readonly goal = signal<Place | undefined>(undefined)
  /** What the next click sets. */
  readonly next = signal<'start' | 'goal'>('start')
  readonly caution = signal<keyof typeof CAUTIONS>('careful')
  readonly state = signal<PlanState>('none')
  /** The best plan first, then alternatives. */
  readonly plans = signal<readonly Plan[]>([])
  readonly chosenIdx = signal(0)
  readonly failure = signal('')
  readonly chosen = computed(() => this.plans.value[this.chosenIdx.value])
  /** Where an NPC can get to instead, if there is no path to the goal. */
  readonly nearest = computed(() => {
    const best = this.plans.value[0]
    return best === undefined || best.found ? undefined : best.nearestReachable
  })
  readonly lines = computed<PathLine[]>(() => {
    const start = this.start.value
    if (start === undefined) return []
    return this.plans.value
      .map((plan, index) => ({ plan, chosen: index === this.chosenIdx.value }))
      .filter(({ plan }) => plan.found)
      .map(({ plan, chosen }) => ({
        start,
        waypoints: plan.waypoints,
        abilities: plan.legs.map(({ ability }) => ability),
        chosen,
      }))
  })
  private running: AbortController | undefined
  private graphId: string | undefined

  /** `given`: what is known of movers. */
  constructor(
    private readonly context: Context,
    private readonly given: ReadonlySignal<readonly MoverStops[]>,
  ) {}

  /** A click on the map. */
  click(at: Place): void {
    if (this.next.value === 'start') this.setStart(at)
    else this.setGoal(at)
  }

  setStart(at: Place): void {
    batch(() => {
      this.chosenIdx.value = 0
      this.start.value = at
      this.next.value = 'goal'
    })
    void this.ask()
  }

  setGoal(at: Place): void {
    batch(() => {
      this.chosenIdx.value = 0
      this.goal.value = at
      this.next.value = this.start.value === undefined ? 'start' : 'goal'
    })
    void this.ask()
  }

  /** Sets both ends, as a link has them. */
  setEnds(start: Place | undefined, goal: Place | undefined): void {
    batch(() => {
      this.chosenIdx.value = 0
      this.start.value = start
      this.goal.value = goal
      this.next.value = start === undefined ? 'start' : 'goal'
    })
    void this.ask()
  }

  swap(): void {
    batch(() => {
      const start = this.start.value
      this.start.value = this.goal.value
      this.goal.value = start
    })
    void this.ask()
  }

  clear(): void {
    this.running?.abort()
    batch(() => {
      this.start.value = undefined
      this.goal.value = undefined
      this.next.value = 'start'
      this.plans.value = []
      this.chosenIdx.value = 0
      this.state.value = 'none'
    })
  }

  setCaution(caution: keyof typeof CAUTIONS): void {
    this.caution.value = caution
    void this.ask()
  }

  choose(index: number): void {
    this.chosenIdx.value = index
  }

  /** Plans again, because movers have moved. */
  replan(): void {
    void this.ask(true)
  }

  /** Plans again on another or a changed graph. A chosen alternative stays chosen as long as it exists. */
  useGraph(graphId: string | undefined): void {
    this.graphId = graphId
    void this.ask(true)
  }

  private async ask(quietly = false): Promise<void> {
    this.running?.abort()
    const { graphId } = this
    const [start, goal] = [this.start.peek(), this.goal.peek()]
    if (graphId === undefined || start === undefined || goal === undefined) return
    const { signal } = (this.running = new AbortController())
    if (!quietly) this.state.value = 'asking'
    try {
      const query = { start, goal, caution: CAUTIONS[this.caution.peek()], movers: [...this.given.peek()] }
      const { plan: best } = await this.context.planner.calls.findPath({ graphId, query }, { signal })
      if (best === undefined) return
      if (!quietly) this.take([best])
      const alternatives = best.found ? await this.findAlternatives(graphId, query, best, signal) : []
      if (!signal.aborted) this.take([best, ...alternatives])
    } catch (error) {
      if (signal.aborted || failureOf(error) === 'cancelled') return
      batch(() => {
        this.state.value = 'failed'
        this.failure.value = inWords(error)
        this.plans.value = []
      })
    }
  }

  private take(plans: readonly Plan[]): void {
    const chosen = this.chosenIdx.peek() > 0 ? this.chosen.peek() : undefined
    const stays = chosen === undefined ? 0 : plans.findIndex((plan) => legKey(plan) === legKey(chosen))
    batch(() => {
      this.plans.value = plans
      this.chosenIdx.value = Math.max(0, stays)
      this.state.value = 'ready'
    })
  }

  private async findAlternatives(
    graphId: string,
    given: { start: Place; goal: Place; caution: number; movers: PathQuery['movers'] },
    best: Plan,
    signal: AbortSignal,
  ) {
    const queries = alternativeQueries(given, best)
    if (queries.length === 0) return []
    try {
      const { plans } = await this.context.planner.calls.findPaths({ graphId, queries }, { signal })
      return pickAlternatives(best, plans)
    } catch (error) {
      // The best plan stands without them, unless the planner is gone.
      if (failureOf(error) === 'refused') return []
      throw error
    }
  }
}
