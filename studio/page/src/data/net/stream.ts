// Streams that are opened again whenever they break, and calls that are repeated.

import { Code, ConnectError } from '@connectrpc/connect'
import { pauseAfter, sleep } from './backoff'
import { failureOf, mayPass } from './errors'
import type { Link } from './link'
import type { Session } from './session'

export interface Upkeep {
  link: Link
  session: Session
  signal: AbortSignal
}

/** How often in a row `work` may end with an error within the service, where trying again would cost it much. */
export interface Patience {
  breakdowns?: number
}

/**
 * Repeats `work` until the signal aborts, with growing pauses while it fails. Returns the error that a retry cannot fix,
 * if there was one. `work` calls its argument when it has received something.
 */
export async function keepDoing(
  { link, session, signal }: Upkeep,
  work: (gotSomething: () => void) => Promise<void>,
  { breakdowns = Infinity }: Patience = {},
): Promise<unknown> {
  let failures = 0
  let broken = 0
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
      broken = ConnectError.from(error).code === Code.Internal ? broken + 1 : 0
      if (!mayPass(failure) || broken >= breakdowns) return error
      failures += 1
    }
    await sleep(pauseAfter(failures), signal)
  }
  return undefined
}

/** Reads a stream for as long as the signal allows, and opens it again if nothing comes for too long; see `keepDoing`. */
export function keepReading<T>(
  upkeep: Upkeep,
  open: (signal: AbortSignal) => AsyncIterable<T>,
  take: (message: T) => void,
  idleMs?: number,
): Promise<unknown> {
  return keepDoing(upkeep, async (gotSomething) => {
    const watch = new IdleWatch(idleMs)
    const signal = AbortSignal.any([upkeep.signal, watch.signal])
    try {
      for await (const message of open(signal)) {
        if (signal.aborted) break
        watch.heard()
        gotSomething()
        take(message)
      }
    } catch (error) {
      if (!watch.signal.aborted) throw error
    } finally {
      watch.end()
    }
    if (watch.signal.aborted) throw new ConnectError('nothing came for too long', Code.DeadlineExceeded)
  })
}

/** Aborts when nothing is heard for some time. */
class IdleWatch {
  private readonly stop = new AbortController()
  readonly signal = this.stop.signal
  private timer: ReturnType<typeof setTimeout> | undefined

  constructor(private readonly idleMs: number | undefined) {
    this.heard()
  }

  heard(): void {
    clearTimeout(this.timer)
    if (this.idleMs !== undefined) this.timer = setTimeout(() => this.stop.abort(), this.idleMs)
  }

  end(): void {
    clearTimeout(this.timer)
  }
}

/** Calls until there is an answer; throws an error that a retry cannot fix. Returns undefined if the signal aborted. */
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
