// The tour: its steps, where it is, and whether it was offered before. Steps point at real controls, and each is done
// once the user has done the thing.

import { batch, computed, signal } from '@preact/signals'

const KEPT_AS = 'surefoot.tour'

/** What the tour notices. */
export interface TourFacts {
  /** Turns, moves and zooms of the camera by hand so far. */
  looks: number
  /** The NPC that the camera follows. */
  follows: bigint | undefined
  /** Tells plans apart; undefined: none is shown. */
  plan: string | undefined
  /** NPCs that were sent to a goal so far. */
  sent: number
  /** Edges that are forbidden. */
  forbidden: number
}

export interface TourStep {
  name: 'look' | 'follow' | 'plan' | 'send' | 'forbid' | 'undo'
  title: string
  text: string
  /** Selects the control that it is about; the first one that is there counts. */
  target: string
  isDone(before: TourFacts, now: TourFacts): boolean
}

/** Gestures that count as looking around; a drag makes dozens a second. */
const LOOKS = 12

export const TOUR_STEPS: readonly TourStep[] = [
  {
    name: 'look',
    title: 'Look around',
    text: 'Drag to orbit and turn the wheel to zoom. The camera stays with the NPC. Try it.',
    target: '.canvas',
    isDone: (before, now) => now.looks >= before.looks + LOOKS,
  },
  {
    name: 'follow',
    title: 'Follow another NPC',
    text: 'Press J or this button. The coloured line is its plan; each colour is an ability that a leg needs.',
    target: '[data-tour=another]',
    isDone: (before, now) => now.follows !== undefined && now.follows !== before.follows,
  },
  {
    name: 'plan',
    title: 'Ask for a plan',
    text: 'Press 2 or this button, then click where to start and where to go. Choose places far apart.',
    target: '[data-tour=tool-plan]',
    isDone: (before, now) => now.plan !== undefined && now.plan !== before.plan,
  },
  {
    name: 'send',
    title: 'Send an NPC',
    text: 'The Plan tab lists the legs with their chances. Send an NPC along them.',
    target: '[data-tour=send]',
    isDone: (before, now) => now.sent > before.sent,
  },
  {
    name: 'forbid',
    title: 'Forbid a leg',
    text: 'Choose a leg that the NPC has not reached yet and press "Forbid this leg". All NPCs take other routes.',
    target: '[data-tour=forbid], [data-tour=legs]',
    isDone: (before, now) => now.forbidden > before.forbidden,
  },
  {
    name: 'undo',
    title: 'Undo it',
    text: 'Press Ctrl Z or this button: the leg is allowed again.',
    target: '[data-tour=undo]',
    isDone: (before, now) => now.forbidden < before.forbidden,
  },
]

export class Tour {
  /** Index of the step; TOUR_STEPS.length: its last card; undefined: there is no tour. */
  readonly at = signal<number | undefined>(undefined)
  readonly isOffered = signal(false)
  /** Whether the user has done what the step asks for. */
  readonly isDone = signal(false)
  readonly step = computed(() => (this.at.value === undefined ? undefined : TOUR_STEPS[this.at.value]))
  private before: TourFacts | undefined

  constructor(private readonly store: Pick<Storage, 'getItem' | 'setItem'> | undefined) {}

  /** Offers the tour, unless it was offered on an earlier visit. A browser that keeps nothing gets no offer. */
  offer(): void {
    if (this.store !== undefined && this.store.getItem(KEPT_AS) === null) this.isOffered.value = true
  }

  start(): void {
    this.remember()
    this.turnTo(0)
  }

  /** Declines the offer, or ends the tour. */
  end(): void {
    this.remember()
    this.turnTo(undefined)
  }

  next(): void {
    const at = this.at.peek()
    if (at !== undefined) this.turnTo(at < TOUR_STEPS.length ? at + 1 : undefined)
  }

  back(): void {
    const at = this.at.peek()
    if (at !== undefined && at > 0) this.turnTo(at - 1)
  }

  /** Notices what the user has done. */
  take(facts: TourFacts): void {
    const step = this.step.peek()
    if (step === undefined || this.isDone.peek()) return
    this.before ??= facts
    if (step.isDone(this.before, facts)) this.isDone.value = true
  }

  private turnTo(at: number | undefined): void {
    batch(() => {
      this.before = undefined
      this.isDone.value = false
      this.isOffered.value = false
      this.at.value = at
    })
  }

  private remember(): void {
    this.store?.setItem(KEPT_AS, 'seen')
  }
}
