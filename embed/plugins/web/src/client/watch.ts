// Streams that are opened again whenever they break.

import { Code, ConnectError } from '@connectrpc/connect'

const [FIRST_PAUSE_MS, LONGEST_PAUSE_MS] = [250, 5000]

/** Errors that a retry cannot repair: the call itself is refused. */
const FINAL: readonly Code[] = [
  Code.InvalidArgument,
  Code.NotFound,
  Code.PermissionDenied,
  Code.Unauthenticated,
  Code.Unimplemented,
  Code.FailedPrecondition,
  Code.OutOfRange,
]

export interface WatchOptions {
  /** Ends the stream without an error. */
  signal?: AbortSignal
  /** Called with the reason why a stream broke, before it is opened again. */
  onBreak?: (error: unknown) => void
}

/**
 * Yields the messages of a stream and opens it again, with growing pauses, when it ends or breaks.
 * @throws ConnectError that a retry cannot repair.
 */
export async function* keepWatching<T>(
  open: (signal: AbortSignal) => AsyncIterable<T>,
  { signal = new AbortController().signal, onBreak }: WatchOptions = {},
): AsyncGenerator<T, void> {
  // Leaving the loop over this generator cancels the stream as well.
  const stop = new AbortController()
  const both = AbortSignal.any([signal, stop.signal])
  let failures = 0
  try {
    while (!both.aborted) {
      try {
        for await (const message of open(both)) {
          failures = 0
          yield message
        }
      } catch (error) {
        if (both.aborted) return
        if (FINAL.includes(ConnectError.from(error).code)) throw error
        onBreak?.(error)
      }
      failures += 1
      await sleep(Math.min(LONGEST_PAUSE_MS, FIRST_PAUSE_MS * 2 ** (failures - 1)), both)
    }
  } finally {
    stop.abort()
  }
}

/** Waits; ends early, without an error, when the signal aborts. */
function sleep(milliseconds: number, signal: AbortSignal): Promise<void> {
  return new Promise((resolve) => {
    if (signal.aborted) return resolve()
    const done = () => {
      clearTimeout(timer)
      signal.removeEventListener('abort', done)
      resolve()
    }
    const timer = setTimeout(done, milliseconds)
    signal.addEventListener('abort', done)
  })
}
