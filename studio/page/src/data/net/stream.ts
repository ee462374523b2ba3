// Streams that are opened again whenever they break, and calls that are repeated.

import { pauseAfter, sleep } from './backoff'
import { failureOf, mayPass } from './errors'
import type { Link } from './link'
import type { Session } from './session'

export interface Upkeep {
  link: Link
  session: Session
  signal: AbortSignal
}

/**
 * Does `work` again and again until the signal aborts, with growing pauses while it fails. Returns the error that trying
 * again cannot mend, if there was one. `work` says with its argument that it has got something.
 */
export async function keepDoing(
  { link, session, signal }: Upkeep,
  work: (gotSomething: () => void) => Promise<void>,
): Promise<unknown> {
  let failures = 0
  while (!signal.aborted) {
    try {
      await work(() => {
        failures = 0
        link.worked()
      })
      failures += 1
    } catch (error) {
      if (signal.aborted) return undefined
      link.failed(error)
      const failure = failureOf(error)
      if (failure === 'token') {
        session.notice(error)
        await session.nextToken(signal)
        failures = 0
        continue
      }
      if (!mayPass(failure)) return error
      failures += 1
    }
    await sleep(pauseAfter(failures), signal)
  }
  return undefined
}

/** Reads a stream for as long as the signal allows; see `keepDoing`. */
export function keepReading<T>(
  upkeep: Upkeep,
  open: (signal: AbortSignal) => AsyncIterable<T>,
  take: (message: T) => void,
): Promise<unknown> {
  return keepDoing(upkeep, async (gotSomething) => {
    for await (const message of open(upkeep.signal)) {
      if (upkeep.signal.aborted) return
      gotSomething()
      take(message)
    }
  })
}

/** Calls until there is an answer; throws what trying again cannot mend, undefined if the signal aborted. */
export async function keepAsking<T>(upkeep: Upkeep, call: (signal: AbortSignal) => Promise<T>): Promise<T | undefined> {
  const stop = new AbortController()
  const signal = AbortSignal.any([upkeep.signal, stop.signal])
  let answer: T | undefined
  const error = await keepDoing({ ...upkeep, signal }, async (gotSomething) => {
    answer = await call(upkeep.signal)
    gotSomething()
    stop.abort()
  })
  if (error !== undefined) throw error
  return upkeep.signal.aborted ? undefined : answer
}
