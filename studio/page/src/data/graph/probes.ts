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

/** Probes made here along an edge. */
export function tally(probes: readonly Probe[], from: number, to: number): { tries: number; successes: number } {
  const made = probes.filter((probe) => probe.from === from && probe.to === to)
  return { tries: made.length, successes: made.filter(({ result }) => result.reached).length }
}

/** Plays the way of a probe; see Viewport.playTrack. */
export type TrackPlayer = (track: Float32Array, reached: boolean, done: () => void) => void

export class Probes {
  readonly made = signal<readonly Probe[]>([])
  readonly running = signal(false)
  readonly playing = signal(false)
  private seed = BigInt(Date.now())

  constructor(
    private readonly context: Context,
    private readonly play: TrackPlayer,
  ) {}

  forget(): void {
    this.made.value = []
  }

  last(from: number, to: number): Probe | undefined {
    return this.made.value.filter((probe) => probe.from === from && probe.to === to).at(-1)
  }

  async probe(graphId: string, from: number, to: number): Promise<void> {
    this.running.value = true
    try {
      this.seed += 1n
      const result = await this.context.planner.calls.probeEdge({ graphId, from, to, seed: this.seed })
      this.made.value = [...this.made.value, { from, to, result, counted: false }]
      this.replay(result)
    } catch (error) {
      report(this.context, 'The edge was not probed', error)
    } finally {
      this.running.value = false
    }
  }

  replay(result: ProbeEdgeResponse): void {
    this.playing.value = true
    this.play(readFloats(result.track), result.reached, () => {
      this.playing.value = false
    })
  }

  /** Adds the probes made here along an edge to its evidence. */
  async count(graphId: string, from: number, to: number): Promise<void> {
    const isMeant = (probe: Probe) => probe.from === from && probe.to === to && !probe.counted
    const traversals = this.made.value
      .filter(isMeant)
      .map(({ result }) => ({ from, to, reached: result.reached, decisions: result.decisions }))
    if (traversals.length === 0) return
    try {
      const { accepted } = await this.context.planner.calls.reportTraversals({ graphId, traversals })
      this.made.value = this.made.value.map((probe) => (isMeant(probe) ? { ...probe, counted: true } : probe))
      this.context.toasts.say(`${accepted} of ${traversals.length} counted as evidence.`, 'good')
    } catch (error) {
      if (failureOf(error) !== 'role') return report(this.context, 'Not counted', error)
      this.context.toasts.say('Not counted: your token may not add evidence.', 'bad')
    }
  }
}
