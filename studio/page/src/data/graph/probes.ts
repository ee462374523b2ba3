// Trying edges again from the page.

import { signal } from '@preact/signals'
import type { ProbeEdgeResponse } from '../../gen/surefoot/planner/v1/planner_pb'
import { abilityDone } from '../abilities'
import { type Context, report } from '../context'
import { duration } from '../format'
import { failureOf } from '../net/errors'
import { readFloats } from '../world/tiles'

const DECISION_SECONDS = 1 / 6

/** A probe that was made here. */
export interface Probe {
  /** Indices of vertices mean something in their graph only. */
  graphId: string
  from: number
  to: number
  result: ProbeEdgeResponse
  counted: boolean
}

/** "Arrived after 3.2 s, jumped" */
export function probeInWords({ reached, decisions, ability }: ProbeEdgeResponse): string {
  const seconds = duration(decisions * DECISION_SECONDS)
  return reached ? `Arrived after ${seconds}, ${abilityDone(ability)}` : `Did not arrive within ${seconds}`
}

/** An edge of a graph. */
export type ProbedEdge = Pick<Probe, 'graphId' | 'from' | 'to'>

function along({ graphId, from, to }: ProbedEdge): (probe: Probe) => boolean {
  return (probe) => probe.graphId === graphId && probe.from === from && probe.to === to
}

/** Probes made here along an edge. */
export function tally(probes: readonly Probe[], edge: ProbedEdge) {
  const made = probes.filter(along(edge))
  return {
    tries: made.length,
    successes: made.filter(({ result }) => result.reached).length,
    uncounted: made.filter(({ counted }) => !counted).length,
  }
}

/** Plays the way of a probe; see Viewport.playTrack. */
export type TrackPlayer = (track: Float32Array, reached: boolean, done: () => void) => void

export class Probes {
  readonly made = signal<readonly Probe[]>([])
  readonly running = signal(false)
  readonly playing = signal(false)
  private seed = BigInt(Date.now())
  /** Which replay it is: the one before ends when another begins. */
  private turn = 0

  constructor(
    private readonly context: Context,
    private readonly play: TrackPlayer,
  ) {}

  forget(): void {
    this.made.value = []
  }

  last(edge: ProbedEdge): Probe | undefined {
    return this.made.value.filter(along(edge)).at(-1)
  }

  async probe({ graphId, from, to }: ProbedEdge): Promise<void> {
    this.running.value = true
    try {
      this.seed += 1n
      const result = await this.context.planner.calls.probeEdge({ graphId, from, to, seed: this.seed })
      this.made.value = [...this.made.value, { graphId, from, to, result, counted: false }]
      this.replay(result)
    } catch (error) {
      report(this.context, 'The edge was not probed', error)
    } finally {
      this.running.value = false
    }
  }

  replay(result: ProbeEdgeResponse): void {
    const turn = ++this.turn
    this.playing.value = true
    this.play(readFloats(result.track), result.reached, () => {
      if (turn === this.turn) this.playing.value = false
    })
  }

  /** Adds the probes made here along an edge to its evidence. */
  async count({ graphId, from, to }: ProbedEdge): Promise<void> {
    const meant = new Set(this.made.value.filter(along({ graphId, from, to })).filter(({ counted }) => !counted))
    const traversals = [...meant].map(({ result }) => ({
      from,
      to,
      reached: result.reached,
      decisions: result.decisions,
    }))
    if (traversals.length === 0) return
    try {
      const { accepted } = await this.context.planner.calls.reportTraversals({ graphId, traversals })
      this.made.value = this.made.value.map((probe) => (meant.has(probe) ? { ...probe, counted: true } : probe))
      this.context.toasts.say(`${accepted} of ${traversals.length} counted as evidence.`, 'good')
    } catch (error) {
      if (failureOf(error) !== 'role') return report(this.context, 'Not counted', error)
      this.context.toasts.say('Not counted: your token may not add evidence.', 'bad')
    }
  }
}
