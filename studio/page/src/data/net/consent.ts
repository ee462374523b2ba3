// Which addresses the page may call. Its own origin and the planner that its server names need nobody's word. Whatever a
// link names beside these is called only after the user has agreed to its origin.

import { type Address, AddressError, DEFAULT_PLANNER, parseAddress } from './address'

const KEPT_AS = 'surefoot.confirmed-origins'

export type ServiceName = 'world server' | 'planner'

/** A service that the page may call. */
export interface ServiceAddress extends Address {
  /** Whether only a link has named its origin, and the user has agreed to it. */
  isForeign: boolean
}

/** What the user is asked before a foreign origin is contacted. */
export interface Question {
  service: ServiceName
  /** The origin that a link names. */
  origin: string
  /** The origin that is used if the user declines. */
  otherwise: string
}

/** Origins that the user has agreed to; kept by the browser, if it keeps anything. */
export class ConfirmedOrigins {
  private readonly origins: Set<string>

  constructor(private readonly store: Pick<Storage, 'getItem' | 'setItem'> | undefined) {
    this.origins = new Set(readOrigins(store?.getItem(KEPT_AS)))
  }

  has(origin: string): boolean {
    return this.origins.has(origin)
  }

  add(origin: string): void {
    this.origins.add(origin)
    this.store?.setItem(KEPT_AS, JSON.stringify([...this.origins]))
  }
}

function readOrigins(text: string | null | undefined): string[] {
  try {
    const kept: unknown = JSON.parse(text ?? '[]')
    return Array.isArray(kept) ? kept.filter((origin) => typeof origin === 'string') : []
  } catch {
    return []
  }
}

export interface Addresses {
  world: ServiceAddress
  planner: ServiceAddress
  /** Sentences about addresses that cannot be used. */
  refusals: string[]
}

/** Decides where the services are; contacts nobody. `namedPlanner` is what the server of the page says. */
export async function chooseAddresses(
  page: URL,
  namedPlanner: string | undefined,
  confirmed: ConfirmedOrigins,
  ask: (question: Question) => Promise<boolean>,
): Promise<Addresses> {
  const refusals: string[] = []
  const read = (text: string | null | undefined, what: string): Address | undefined => {
    if (text === null || text === undefined || text.trim() === '') return undefined
    try {
      return parseAddress(text, page)
    } catch (error) {
      if (!(error instanceof AddressError)) throw error
      refusals.push(`${what} ${error.message}.`)
      return undefined
    }
  }
  const ownWorld: Address = { url: page.origin, origin: page.origin }
  const ownPlanner =
    read(namedPlanner, 'The address of the planner in studio.json') ?? parseAddress(DEFAULT_PLANNER, page)
  const own = new Set([ownWorld.origin, ownPlanner.origin])
  const declined = new Set<string>()
  const choose = async (service: ServiceName, parameter: string, fallback: Address): Promise<ServiceAddress> => {
    const named = read(page.searchParams.get(parameter), `The ${service}'s address in this link`)
    if (named === undefined || own.has(named.origin)) return { ...(named ?? fallback), isForeign: false }
    const { origin } = named
    if (!confirmed.has(origin) && !declined.has(origin)) {
      const isAgreed = await ask({ service, origin, otherwise: fallback.origin })
      if (isAgreed) confirmed.add(origin)
      else declined.add(origin)
    }
    return confirmed.has(origin) ? { ...named, isForeign: true } : { ...fallback, isForeign: false }
  }
  // Questions are asked one after another, and once per origin.
  const world = await choose('world server', 'server', ownWorld)
  const planner = await choose('planner', 'planner', ownPlanner)
  return { world, planner, refusals }
}
