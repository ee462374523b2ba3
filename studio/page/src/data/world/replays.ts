// The replay of an attempt: which one, at which moment, and whether it plays. The live world goes on meanwhile.

import { batch, computed, signal } from '@preact/signals'
import { type AttemptEnded, Outcome } from '../../gen/surefoot/world/v1/world_pb'
import { type Motion, type MotionFacts, motionOf } from './motion'
import type { Attempt, Recorder } from './recorder'

const TICKS_A_SECOND = 60

export interface ShownAttempt extends Attempt {
  npcId: bigint
  /** Undefined while it has not ended, or if another goal replaced it. */
  outcome: Outcome | undefined
  motion: Motion
}

export class Replays {
  readonly shown = signal<ShownAttempt | undefined>(undefined)
  readonly seconds = signal(0)
  readonly playing = signal(false)
  readonly length = computed(() => {
    const shown = this.shown.value
    return shown === undefined ? 0 : (shown.track.length / 3 - 1) / TICKS_A_SECOND
  })

  constructor(
    private readonly recorder: Recorder,
    private readonly factsOf: (npcId: bigint) => MotionFacts,
  ) {}

  /**
   * Plays the last attempt of an NPC that has ended, or the present one where no other was received; returns whether
   * there is one. `begun`: attempts that it has begun; `history`: attempts that have ended.
   */
  open(npcId: bigint, begun: number, history: readonly AttemptEnded[]): boolean {
    const ended = [...history].reverse().map(({ attempt }) => attempt)
    for (const attempt of [...ended, begun]) {
      const found = this.recorder.attempt(npcId, attempt)
      if (found === undefined) continue
      const outcome = history.find((past) => past.attempt === attempt)?.outcome
      const motion = motionOf(found.poses, this.factsOf(npcId))
      batch(() => {
        this.shown.value = { ...found, npcId, outcome: outcome === Outcome.UNSPECIFIED ? undefined : outcome, motion }
        this.seconds.value = 0
        this.playing.value = true
      })
      return true
    }
    return false
  }

  close(): void {
    batch(() => {
      this.shown.value = undefined
      this.playing.value = false
    })
  }

  /** Shows the moment so many seconds after the start, and stops there. */
  seek(seconds: number): void {
    batch(() => {
      this.playing.value = false
      this.seconds.value = Math.min(this.length.value, Math.max(0, seconds))
    })
  }

  /** Plays on, from the start if it is over; or stops. */
  toggle(): void {
    batch(() => {
      if (!this.playing.value && this.seconds.value >= this.length.value) this.seconds.value = 0
      this.playing.value = !this.playing.value && this.shown.value !== undefined
    })
  }

  /** So many seconds have passed. */
  advance(elapsed: number): void {
    if (!this.playing.peek()) return
    batch(() => {
      this.seconds.value = Math.min(this.length.value, this.seconds.value + elapsed)
      if (this.seconds.value >= this.length.value) this.playing.value = false
    })
  }
}
