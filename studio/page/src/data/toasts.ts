// Short messages that go by themselves.

import { signal } from '@preact/signals'

export type Tone = 'info' | 'good' | 'bad'

export interface Toast {
  id: number
  text: string
  tone: Tone
}

const SHOWN_MS: Record<Tone, number> = { info: 6000, good: 4000, bad: 10_000 }
/** At most so many at a time. */
const MAX_SHOWN = 4

export class Toasts {
  readonly shown = signal<readonly Toast[]>([])
  private nextId = 1

  say(text: string, tone: Tone = 'info'): void {
    const id = this.nextId++
    const others = this.shown.peek().filter((toast) => toast.text !== text)
    this.shown.value = [...others, { id, text, tone }].slice(-MAX_SHOWN)
    setTimeout(() => this.dismiss(id), SHOWN_MS[tone])
  }

  dismiss(id: number): void {
    this.shown.value = this.shown.peek().filter((toast) => toast.id !== id)
  }
}
