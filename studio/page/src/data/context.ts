// What all parts of the page's data share.

import { failureOf, inWords } from './net/errors'
import type { PlannerSide, WorldSide } from './net/services'
import type { Toasts } from './toasts'

export interface Context {
  world: WorldSide
  planner: PlannerSide
  toasts: Toasts
  /** What the browser keeps from visit to visit, if it does. */
  store: Pick<Storage, 'getItem' | 'setItem'> | undefined
  /** Ends everything when the page goes. */
  signal: AbortSignal
}

/** Says what went wrong, unless the page itself took it back or asks for a token anyway. */
export function report(context: Context, what: string, error: unknown): void {
  const failure = failureOf(error)
  if (failure === 'cancelled' || failure === 'token') return
  context.toasts.say(`${what}: ${inWords(error)}`, 'bad')
}

/** Says that edits need another token, and asks for one. */
export function reportEdit(context: Context, what: string, error: unknown): void {
  if (failureOf(error) !== 'role') return report(context, what, error)
  context.toasts.say(`${what}: your token does not allow edits. A designer's token is needed.`, 'bad')
  context.planner.session.ask("Edits need a designer's token.")
}
