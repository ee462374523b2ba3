// Where the two services are.

/** Port of a planner that nobody has named. */
export const DEFAULT_PLANNER = ':7601'

/** The world server: it serves this page, unless `?server=` names another. */
export function worldAddress(page: URL): string {
  const named = page.searchParams.get('server')
  return named ? withoutSlash(named) : page.origin
}

/** The planner: an absolute URL, or ":PORT" for the host and protocol of the page. */
export function plannerAddress(named: string | undefined, page: URL): string {
  const text = (page.searchParams.get('planner') ?? named ?? '').trim() || DEFAULT_PLANNER
  return /^:\d+$/.test(text) ? `${page.protocol}//${page.hostname}${text}` : withoutSlash(text)
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

function withoutSlash(address: string): string {
  return address.replace(/\/+$/, '')
}
