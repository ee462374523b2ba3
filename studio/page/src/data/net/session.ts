// The token that calls are made with.

import { Code, ConnectError, type Interceptor } from '@connectrpc/connect'
import { signal } from '@preact/signals'

const KEPT_AS = 'surefoot.token'

/** Where the token lives for as long as the tab does. */
export type TokenStore = Pick<Storage, 'getItem' | 'setItem' | 'removeItem'>

export class Session {
  readonly token = signal('')
  /** Why a token is asked for; undefined: it is not. */
  readonly wanted = signal<string | undefined>(undefined)
  /** Whether a service has refused what this page calls with. */
  readonly refused = signal(false)
  private waiting: (() => void)[] = []

  constructor(private readonly store: TokenStore | undefined) {
    this.token.value = store?.getItem(KEPT_AS) ?? ''
  }

  ask(why: string): void {
    this.wanted.value ??= why
  }

  /** Takes a token, and lets everything go on that waits for one. */
  give(token: string): void {
    this.token.value = token.trim()
    if (this.token.value === '') this.store?.removeItem(KEPT_AS)
    else this.store?.setItem(KEPT_AS, this.token.value)
    this.wanted.value = undefined
    this.refused.value = false
    const waiting = this.waiting
    this.waiting = []
    for (const go of waiting) go()
  }

  dismiss(): void {
    this.wanted.value = undefined
  }

  /** Resolves when the next token is given, or the signal aborts. */
  nextToken(signal: AbortSignal): Promise<void> {
    return new Promise((resolve) => {
      this.waiting.push(resolve)
      signal.addEventListener('abort', () => resolve(), { once: true })
    })
  }

  /** Says to the prompt what a service said to a call. */
  notice(error: unknown): void {
    if (ConnectError.from(error).code !== Code.Unauthenticated) return
    this.refused.value = true
    this.ask(this.token.value === '' ? 'This server asks for a token.' : 'The server does not know this token.')
  }

  readonly interceptor: Interceptor = (next) => async (request) => {
    if (this.token.value !== '') request.header.set('authorization', `Bearer ${this.token.value}`)
    try {
      return await next(request)
    } catch (error) {
      this.notice(error)
      throw error
    }
  }
}
