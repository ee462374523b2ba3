// Whether a service answers.

import { Code, ConnectError, type Interceptor } from '@connectrpc/connect'
import { signal } from '@preact/signals'
import { inWords } from './errors'

export type LinkState = 'connecting' | 'live' | 'lost'

/** What browsers and gateways report when nobody answers. */
const UNREACHABLE: readonly Code[] = [Code.Unknown, Code.Unavailable]
/** The page took the call back, or its connection was cut within: neither tells anything of the service. */
const SAYS_NOTHING: readonly Code[] = [Code.Canceled, Code.Internal, Code.DataLoss]
/** Calls that may go unanswered in a row: one may only have taken long. */
const MOST_UNANSWERED = 1

/** The connection to one service, as everything that talks to it has seen it last. */
export class Link {
  readonly state = signal<LinkState>('connecting')
  /** Why it was lost, for people. */
  readonly reason = signal('')
  /** Whether the page's Content-Security-Policy keeps the browser from calling it. */
  readonly blocked = signal(false)
  private unanswered = 0
  private latest: unknown

  worked(): void {
    this.unanswered = 0
    this.state.value = 'live'
    this.reason.value = ''
    this.blocked.value = false
  }

  /** Notes an error; one that the service itself gave shows that it is there. */
  failed(error: unknown): void {
    const { code } = ConnectError.from(error)
    // Both the call and its repetition report the failure.
    if (error === this.latest) return
    this.latest = error
    if (SAYS_NOTHING.includes(code)) return
    if (code === Code.DeadlineExceeded) {
      this.unanswered += 1
      if (this.unanswered <= MOST_UNANSWERED) return
    } else if (!UNREACHABLE.includes(code)) return this.worked()
    this.state.value = 'lost'
    this.reason.value = inWords(error)
  }

  readonly interceptor: Interceptor = (next) => async (request) => {
    try {
      const response = await next(request)
      this.worked()
      return response
    } catch (error) {
      this.failed(error)
      throw error
    }
  }
}
