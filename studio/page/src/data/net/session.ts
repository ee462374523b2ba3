// Tokens that calls are made with. Each belongs to the origin that it was typed for and is sent nowhere else.

import { Code, ConnectError, type Interceptor } from '@connectrpc/connect'
import { signal } from '@preact/signals'

/** Prefix of the keys that tokens are kept by; their origin follows. */
const KEPT_AS = 'surefoot.token '
/** The one key of earlier versions, which did not note the origin. */
const KEPT_WITHOUT_ORIGIN = 'surefoot.token'

/** Where tokens live for as long as the tab does. */
export type TokenStore = Pick<Storage, 'getItem' | 'setItem' | 'removeItem'>

/** The sessions of all origins. */
export class Sessions {
  private readonly byOrigin = new Map<string, Session>()

  /** A token that was stored without an origin is assigned to the page's own origin. */
  constructor(
    private readonly store: TokenStore | undefined,
    pageOrigin: string,
  ) {
    const old = store?.getItem(KEPT_WITHOUT_ORIGIN) ?? ''
    store?.removeItem(KEPT_WITHOUT_ORIGIN)
    if (old !== '' && this.at(pageOrigin).token.value === '') this.at(pageOrigin).give(old)
  }

  /** The session of an origin; the same one each time. */
  at(origin: string): Session {
    const known = this.byOrigin.get(origin)
    if (known !== undefined) return known
    const session = new Session(origin, this.store)
    this.byOrigin.set(origin, session)
    return session
  }
}

/** The token of one origin, and whether it is wanted. */
export class Session {
  readonly token = signal('')
  /** Why the page requests a token; undefined: it requests none. */
  readonly wanted = signal<string | undefined>(undefined)
  /** Whether a service has refused what this page calls with. */
  readonly refused = signal(false)
  private waiting: (() => void)[] = []

  constructor(
    readonly origin: string,
    private readonly store: TokenStore | undefined,
  ) {
    this.token.value = store?.getItem(KEPT_AS + origin) ?? ''
  }

  ask(why: string): void {
    this.wanted.value ??= why
  }

  /** Takes a token, and lets everything go on that waits for one. */
  give(token: string): void {
    this.token.value = token.trim()
    if (this.token.value === '') this.store?.removeItem(KEPT_AS + this.origin)
    else this.store?.setItem(KEPT_AS + this.origin, this.token.value)
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
    this.ask(
      this.token.value === '' ? `${this.origin} asks for a token.` : `${this.origin} does not accept this token.`,
    )
  }

  readonly interceptor: Interceptor = (next) => async (request) => {
    if (this.token.value !== '' && new URL(request.url).origin === this.origin) {
      request.header.set('authorization', `Bearer ${this.token.value}`)
    }
    try {
      return await next(request)
    } catch (error) {
      this.notice(error)
      throw error
    }
  }
}

/** A service for which a token can be typed. */
export interface TokenTarget {
  session: Session
  isForeign: boolean
}

/**
 * Which of the services a token is proposed for when `asking` wants one. A foreign service and the page's own ones never
 * share a proposal, and a token that differs is not replaced unasked; the user can choose otherwise.
 */
export function proposedSessions(asking: Session, targets: readonly TokenTarget[]): Set<Session> {
  const areOwn = targets.every(({ isForeign }) => !isForeign)
  const isAlike = ({ token }: Session) => token.peek() === '' || token.peek() === asking.token.peek()
  const alike = areOwn ? targets.map(({ session }) => session).filter(isAlike) : []
  return new Set([asking, ...alike])
}
