// Whom the page calls, and with which token.

import { Code, ConnectError } from '@connectrpc/connect'
import { afterEach, beforeEach, describe, expect, it, vi } from 'vitest'
import { chooseAddresses, ConfirmedOrigins, type Question } from '../../src/data/net/consent'
import { blockedInWords, watchPolicy } from '../../src/data/net/policy'
import { connectPlanner, connectWorld } from '../../src/data/net/services'
import { proposedSessions, Session, Sessions } from '../../src/data/net/session'

const OWN = 'http://127.0.0.1:7600'
const OWN_PLANNER = 'http://127.0.0.1:7601'
const EVIL = 'https://evil.example'

class MemoryStore {
  private readonly kept = new Map<string, string>()
  getItem = (key: string) => this.kept.get(key) ?? null
  setItem = (key: string, value: string) => void this.kept.set(key, value)
  removeItem = (key: string) => void this.kept.delete(key)
  get text(): string {
    return JSON.stringify([...this.kept])
  }
}

/** A call that the browser has sent. */
interface Sent {
  origin: string
  authorization: string | null
}

let sent: Sent[]
let asked: Question[]
let store: MemoryStore
let tabStore: MemoryStore

beforeEach(() => {
  ;[sent, asked, store, tabStore] = [[], [], new MemoryStore(), new MemoryStore()]
  vi.stubGlobal('fetch', async (url: string, init: RequestInit) => {
    sent.push({ origin: new URL(url).origin, authorization: new Headers(init.headers).get('authorization') })
    throw new TypeError('Failed to fetch')
  })
})
afterEach(() => void vi.unstubAllGlobals())

/** Opens the page at `link`, with a server that names its planner. */
async function open(link: string, answer: (question: Question) => Promise<boolean>, planner = ':7601') {
  const page = new URL(link, OWN)
  const ask = (question: Question) => {
    asked.push(question)
    return answer(question)
  }
  const addresses = await chooseAddresses(page, planner, new ConfirmedOrigins(store), ask)
  const sessions = new Sessions(tabStore, page.origin)
  const world = connectWorld(addresses.world, sessions)
  const plans = connectPlanner(addresses.planner, sessions)
  const callBoth = async () => {
    sent = []
    await world.calls.listWorlds({}).catch(() => undefined)
    await plans.calls.listGraphs({}).catch(() => undefined)
    return sent
  }
  return { ...addresses, world, plans, sessions, callBoth }
}

const yes = async () => true
const no = async () => false
const never = () => new Promise<boolean>(() => undefined)
const bearer = (token: string) => `Bearer ${token}`

describe('addresses', () => {
  it.each([
    ['/', ':7601', OWN_PLANNER],
    ['/', ':9000', 'http://127.0.0.1:9000'],
    ['/', '', OWN_PLANNER],
    ['/', 'https://plans.example/', 'https://plans.example'],
    // The link repeats what the server says, or names the page's own origin.
    ['/?planner=https://plans.example', 'https://plans.example', 'https://plans.example'],
    [`/?planner=${OWN}/planner`, ':7601', `${OWN}/planner`],
    ['/?planner=', ':9000', 'http://127.0.0.1:9000'],
    [`/?server=${OWN}/`, ':7601', OWN_PLANNER],
  ])('%s with the planner %s needs no question', async (link, named, planner) => {
    const { world, plans } = await open(link, never, named)
    expect([world.address, plans.address]).toEqual([OWN, planner])
    expect([world.isForeign, plans.isForeign]).toEqual([false, false])
    expect(asked).toEqual([])
  })

  it.each([
    [`/?planner=${EVIL}`, { service: 'planner', origin: EVIL, otherwise: OWN_PLANNER }],
    [`/?server=${EVIL}`, { service: 'world server', origin: EVIL, otherwise: OWN }],
    ['/?planner=:9001', { service: 'planner', origin: 'http://127.0.0.1:9001', otherwise: OWN_PLANNER }],
    ['/?server=http://localhost:7600', { service: 'world server', origin: 'http://localhost:7600', otherwise: OWN }],
    [
      '/?planner=https://studio.example.evil.example/path',
      { service: 'planner', origin: 'https://studio.example.evil.example', otherwise: OWN_PLANNER },
    ],
  ])('%s needs consent, and no service is contacted before the answer', async (link, question) => {
    let isOpen = false
    void open(link, never).then(() => (isOpen = true))
    await new Promise((resolve) => setTimeout(resolve, 20))
    expect(asked).toEqual([question])
    expect([isOpen, sent]).toEqual([false, []])
  })

  it('that the user declines give way to those of the page', async () => {
    const link = `/?planner=${EVIL}&server=${EVIL}`
    const { callBoth } = await open(link, no)
    expect((await callBoth()).map(({ origin }) => origin)).toEqual([OWN, OWN_PLANNER])
    expect(asked).toHaveLength(1)
    await open(link, no)
    expect(asked, 'no answer is remembered').toHaveLength(2)
  })

  it('that the user confirms are contacted, and not asked about again', async () => {
    const { callBoth, plans } = await open(`/?planner=${EVIL}/plans`, yes)
    expect((await callBoth()).map(({ origin }) => origin)).toEqual([OWN, EVIL])
    expect([plans.address, plans.isForeign]).toEqual([`${EVIL}/plans`, true])
    const again = await open(`/?planner=${EVIL}&server=${EVIL}`, never)
    expect((await again.callBoth()).map(({ origin }) => origin)).toEqual([EVIL, EVIL])
    expect(asked).toHaveLength(1)
    void open(`/?planner=${EVIL}:444`, never)
    await new Promise((resolve) => setTimeout(resolve, 20))
    expect(asked.at(-1)?.origin, 'another port is another origin').toBe(`${EVIL}:444`)
  })

  it.each(['ftp://evil.example', `http://127.0.0.1:7601@evil.example`, 'evil'])(
    'such as %s are refused with a sentence',
    async (address) => {
      const { callBoth, refusals } = await open(`/?planner=${encodeURIComponent(address)}`, yes)
      expect((await callBoth()).map(({ origin }) => origin)).toEqual([OWN, OWN_PLANNER])
      expect(asked).toEqual([])
      expect(refusals).toHaveLength(1)
      expect(refusals[0]).toMatch(/^The planner's address in this link .*\.$/)
    },
  )

  it.each(['{', '7', '[1, null]', '"https://evil.example"'])('kept as %s are no consent', async (text) => {
    store.setItem('surefoot.confirmed-origins', text)
    expect(new ConfirmedOrigins(store).has(EVIL)).toBe(false)
  })
})

describe('tokens', () => {
  it('are sent to the origin that they were given for, and to no other', async () => {
    const { callBoth, sessions } = await open(`/?planner=${EVIL}`, yes)
    sessions.at(OWN).give(' ours ')
    expect(await callBoth()).toEqual([
      { origin: OWN, authorization: bearer('ours') },
      { origin: EVIL, authorization: null },
    ])
    sessions.at(EVIL).give('theirs')
    expect(await callBoth()).toEqual([
      { origin: OWN, authorization: bearer('ours') },
      { origin: EVIL, authorization: bearer('theirs') },
    ])
  })

  it('that are kept do not follow a link', async () => {
    const before = await open('/', never)
    for (const origin of [OWN, OWN_PLANNER]) before.sessions.at(origin).give('ours')
    const { callBoth } = await open(`/?planner=${EVIL}&server=${EVIL}`, yes)
    expect((await callBoth()).map(({ authorization }) => authorization)).toEqual([null, null])
    const after = await open('/', never)
    expect((await after.callBoth()).map(({ authorization }) => authorization)).toEqual([bearer('ours'), bearer('ours')])
  })

  it('kept by earlier versions become those of the page’s own origin only', async () => {
    tabStore.setItem('surefoot.token', 'old')
    const first = await open(`/?planner=${EVIL}`, yes)
    expect(await first.callBoth()).toEqual([
      { origin: OWN, authorization: bearer('old') },
      { origin: EVIL, authorization: null },
    ])
    expect(tabStore.getItem('surefoot.token')).toBeNull()
    const second = await open(`/?server=${EVIL}`, yes)
    expect((await second.callBoth()).map(({ authorization }) => authorization)).toEqual([null, null])
  })

  it('of earlier versions do not replace newer ones', () => {
    new Sessions(tabStore, OWN).at(OWN).give('new')
    tabStore.setItem('surefoot.token', 'old')
    expect(new Sessions(tabStore, OWN).at(OWN).token.value).toBe('new')
  })

  it('are kept for the tab, and forgotten when an empty one is given', () => {
    new Sessions(tabStore, OWN).at(OWN).give('secret')
    expect(new Sessions(tabStore, OWN).at(OWN).token.value).toBe('secret')
    expect(new Sessions(tabStore, OWN).at(OWN_PLANNER).token.value).toBe('')
    new Sessions(tabStore, OWN).at(OWN).give('')
    expect(tabStore.text).toBe('[]')
  })

  it('are asked for with the origin that wants them', () => {
    const session = new Sessions(undefined, OWN).at(EVIL)
    session.notice(new ConnectError('', Code.Unauthenticated))
    expect(session.wanted.value).toContain(EVIL)
  })
})

describe('a typed token', () => {
  const targets = (isForeign: boolean, token = '') => {
    const [world, planner] = [new Session(OWN, undefined), new Session(OWN_PLANNER, undefined)]
    planner.give(token)
    return {
      world,
      planner,
      all: [
        { session: world, isForeign: false },
        { session: planner, isForeign },
      ],
    }
  }

  it('is proposed for both services that the page has of itself', () => {
    const { world, planner, all } = targets(false)
    expect(proposedSessions(world, all)).toEqual(new Set([world, planner]))
  })

  it.each([
    ['one of them is foreign', true, ''],
    ['the other has a token that differs', false, 'another'],
  ])('is proposed only for who asks if %s', (_, isForeign, token) => {
    const { world, planner, all } = targets(isForeign, token)
    expect(proposedSessions(world, all)).toEqual(new Set([world]))
    if (isForeign) expect(proposedSessions(planner, all)).toEqual(new Set([planner]))
  })
})

describe('a service that the page’s policy does not name', () => {
  const violation = (fields: Partial<SecurityPolicyViolationEvent>) =>
    Object.assign(new Event('securitypolicyviolation'), {
      effectiveDirective: 'connect-src',
      disposition: 'enforce',
      blockedURI: `${EVIL}/surefoot.planner.v1.PlannerService/ListGraphs`,
      ...fields,
    })

  it('is known, and how it may be named', async () => {
    const { world, plans } = await open(`/?planner=${EVIL}`, yes)
    const document = new EventTarget()
    watchPolicy(document, [world, plans])
    document.dispatchEvent(violation({ effectiveDirective: 'img-src' }))
    document.dispatchEvent(violation({ disposition: 'report' }))
    document.dispatchEvent(violation({ blockedURI: 'inline' }))
    expect(plans.link.blocked.value).toBe(false)
    document.dispatchEvent(violation({}))
    expect([world.link.blocked.value, plans.link.blocked.value]).toEqual([false, true])
    expect(blockedInWords('planner', plans.session.origin)).toContain(`--studio-connect ${EVIL}`)
    plans.link.worked()
    expect(plans.link.blocked.value).toBe(false)
  })
})
