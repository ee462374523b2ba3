// Whether a service answers.

import { Code, ConnectError, type Interceptor } from '@connectrpc/connect'
import { signal } from '@preact/signals'
import { inWords } from './errors'

export type LinkState = 'connecting' | 'live' | 'lost'

/** What browsers and gateways report when nobody answers. */
const UNREACHABLE: readonly Code[] = [Code.Unknown, Code.Unavailable]
/** The page took the call back, or its connection was cut within: neither tells anything of the service. */
const SAYS_NOTHING: readonly Code[] = [Code.Canceled, Code.DeadlineExceeded, Code.Internal, Code.DataLoss]

/** The connection to one service, as everything that talks to it has seen it last. */
export class Link {
  readonly state = signal<LinkState>('connecting')
  /** Why it was lost, for people. */
  readonly reason = signal('')

  worked(): void {
    this.state.value = 'live'
    this.reason.value = ''
  }

  /** Notes an error; one that the service itself gave shows that it is there. */
  failed(error: unknown): void {
    const { code } = ConnectError.from(error)
    if (SAYS_NOTHING.includes(code)) return
    if (!UNREACHABLE.includes(code)) return this.worked()
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
