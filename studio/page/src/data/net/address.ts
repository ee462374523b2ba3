// Addresses of the two services: which strings are valid, and which addresses the page's server announces.

/** Default port of the planner. */
export const DEFAULT_PLANNER = ':7601'

/** An address of a service that a browser can call. */
export interface Address {
  /** Scheme, host, port and path, without a slash at the end. */
  url: string
  /** Scheme, host (in ASCII) and port. Tokens and the user's consent belong to this. */
  origin: string
}

/** Why a text cannot be used as an address, as the end of a sentence about it. */
export class AddressError extends Error {}

/**
 * Reads an absolute URL, or ":PORT" for the host and scheme of the page.
 * @throws AddressError if the text is neither, is not http or https, or holds a user name or password.
 */
export function parseAddress(text: string, page: URL): Address {
  const trimmed = text.trim()
  const url = urlOf(/^:\d+$/.test(trimmed) ? `${page.protocol}//${page.hostname}${trimmed}` : trimmed)
  if (url.protocol !== 'http:' && url.protocol !== 'https:') {
    throw new AddressError(`begins with "${url.protocol}"; only http: and https: addresses are used`)
  }
  if (url.username !== '' || url.password !== '') {
    throw new AddressError('holds a user name or a password; such addresses are not used')
  }
  return { url: url.origin + url.pathname.replace(/\/+$/, ''), origin: url.origin }
}

function urlOf(text: string): URL {
  try {
    return new URL(text)
  } catch {
    throw new AddressError('is not a complete address such as https://plans.example:7601')
  }
}

/** What studio.json says, if it says anything of use. */
export function plannerNamedIn(json: unknown): string | undefined {
  if (typeof json !== 'object' || json === null || !('planner' in json)) return undefined
  return typeof json.planner === 'string' ? json.planner : undefined
}

/** Reads studio.json beside the page; undefined without it. */
export async function readPlannerName(): Promise<string | undefined> {
  try {
    const response = await fetch('./studio.json', { cache: 'no-store' })
    return response.ok ? plannerNamedIn(await response.json()) : undefined
  } catch {
    return undefined
  }
}
