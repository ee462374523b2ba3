// What the Content-Security-Policy of the page keeps it from.

import type { Link } from './link'
import type { Session } from './session'

interface Watched {
  link: Link
  session: Pick<Session, 'origin'>
}

/** Notes on their links which services the browser was not allowed to call. */
export function watchPolicy(document: EventTarget, services: readonly Watched[]): void {
  document.addEventListener('securitypolicyviolation', (event) => {
    const { effectiveDirective, blockedURI, disposition } = event as SecurityPolicyViolationEvent
    if (effectiveDirective !== 'connect-src' || disposition !== 'enforce' || !URL.canParse(blockedURI)) return
    const { origin } = new URL(blockedURI)
    for (const { link, session } of services) if (session.origin === origin) link.blocked.value = true
  })
}

/** What to do about it, for people. */
export function blockedInWords(service: string, origin: string): string {
  return (
    `This page is not allowed to connect to the ${service} at ${origin}. ` +
    `Start the server of this page with --studio-connect ${origin} to allow it.`
  )
}
