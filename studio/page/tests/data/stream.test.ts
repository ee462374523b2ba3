import { Code, ConnectError } from '@connectrpc/connect'
import { afterEach, beforeEach, describe, expect, it, vi } from 'vitest'
import { pauseAfter, sleep } from '../../src/data/net/backoff'
import { failureOf, inWords, mayPass } from '../../src/data/net/errors'
import { Link } from '../../src/data/net/link'
import { Session } from '../../src/data/net/session'
import { keepAsking, keepDoing, keepReading, type Upkeep } from '../../src/data/net/stream'

const gone = () => new ConnectError('Failed to fetch', Code.Unknown)

function upkeep(): Upkeep & { stop: AbortController } {
  const stop = new AbortController()
  return { link: new Link(), session: new Session('http://127.0.0.1:7600', undefined), signal: stop.signal, stop }
}

describe('pauseAfter', () => {
  it.each([
    [0, 250],
    [1, 250],
    [2, 500],
    [3, 1000],
    [5, 4000],
    [6, 5000],
    [100, 5000],
  ])('%i failures is %i ms', (failures, pause) => {
    expect(pauseAfter(failures)).toBe(pause)
  })
})

describe('failures', () => {
  it.each([
    [Code.Unavailable, 'gone', true],
    [Code.Unknown, 'gone', true],
    [Code.Aborted, 'changed', true],
    [Code.Unauthenticated, 'token', false],
    [Code.PermissionDenied, 'role', false],
    [Code.NotFound, 'missing', false],
    [Code.Unimplemented, 'unsupported', false],
    [Code.ResourceExhausted, 'refused', false],
    [Code.Canceled, 'cancelled', false],
  ])('code %i is %s', (code, failure, passes) => {
    expect(failureOf(new ConnectError('', code))).toBe(failure)
    expect(mayPass(failure as ReturnType<typeof failureOf>)).toBe(passes)
  })

  it('makes sentences of what services say', () => {
    expect(inWords(new ConnectError('no such world', Code.NotFound))).toBe('No such world.')
    expect(inWords(new ConnectError('', Code.InvalidArgument))).toBe('The service gave no reason.')
  })
})

describe('Link', () => {
  it.each([
    [Code.Unavailable, 'lost'],
    [Code.Unknown, 'lost'],
    // The service itself has said so.
    [Code.NotFound, 'live'],
    [Code.PermissionDenied, 'live'],
    // Says nothing about the service.
    [Code.Canceled, 'connecting'],
    [Code.DeadlineExceeded, 'connecting'],
  ])('after code %i it is %s', (code, state) => {
    const link = new Link()
    link.failed(new ConnectError('', code))
    expect(link.state.value).toBe(state)
  })
})

describe('calls that go unanswered', () => {
  const late = () => new ConnectError('', Code.DeadlineExceeded)

  it('are a lost link if there are two in a row', () => {
    const link = new Link()
    link.failed(late())
    link.worked()
    link.failed(late())
    expect(link.state.value).toBe('live')
    link.failed(late())
    expect(link.state.value).toBe('lost')
  })

  it('count once, however many streams report them', () => {
    const [link, error] = [new Link(), late()]
    link.failed(error)
    link.failed(error)
    expect(link.state.value).toBe('connecting')
  })
})

describe('keepDoing', () => {
  beforeEach(() => void vi.useFakeTimers())
  afterEach(() => void vi.useRealTimers())

  it('stops at the third error within the service, where that is wanted', async () => {
    const broken = new ConnectError('the mesh has a hole', Code.Internal)
    let tries = 0
    const work = async () => {
      tries += 1
      throw tries === 2 ? gone() : broken
    }
    const error = keepDoing(upkeep(), work, { breakdowns: 3 })
    await vi.runAllTimersAsync()
    expect(await error).toBe(broken)
    expect(tries).toBe(5)
    expect(inWords(broken)).toBe('The service failed: The mesh has a hole.')
  })
})

describe('keepReading', () => {
  beforeEach(() => void vi.useFakeTimers())
  afterEach(() => void vi.useRealTimers())

  it('opens the stream again with growing pauses, which are reset by a message', async () => {
    const { stop, ...rest } = upkeep()
    const opened: number[] = []
    const taken: number[] = []
    const read = keepReading(
      rest,
      async function* () {
        opened.push(Date.now())
        if (opened.length === 4) yield 1
        throw gone()
      },
      (message) => taken.push(message),
    )
    const began = Date.now()
    await vi.advanceTimersByTimeAsync(250 + 500 + 1000 + 250 + 10)
    expect(opened.map((at) => at - began)).toEqual([0, 250, 750, 1750, 2000])
    expect(taken).toEqual([1])
    expect(rest.link.state.value).toBe('lost')
    stop.abort()
    await vi.runAllTimersAsync()
    expect(await read).toBeUndefined()
  })

  it('opens a silent stream again', async () => {
    const { stop, ...rest } = upkeep()
    let opened = 0
    const read = keepReading(
      rest,
      async function* (signal) {
        opened += 1
        yield opened
        await sleep(600, signal)
        yield opened
        await sleep(60_000, signal)
      },
      () => undefined,
      1000,
    )
    await vi.advanceTimersByTimeAsync(1500)
    expect(opened).toBe(1)
    await vi.advanceTimersByTimeAsync(400)
    expect(opened).toBe(2)
    stop.abort()
    await vi.runAllTimersAsync()
    expect(await read).toBeUndefined()
  })

  it('does not retry permanent failures', async () => {
    const missing = new ConnectError('no such world', Code.NotFound)
    const read = keepReading(
      upkeep(),
      async function* () {
        throw missing
      },
      () => undefined,
    )
    expect(await read).toBe(missing)
  })

  it('waits for a token, and goes on with it', async () => {
    const { stop, ...rest } = upkeep()
    let opened = 0
    const taken: string[] = []
    const read = keepReading(
      rest,
      async function* () {
        opened += 1
        if (rest.session.token.value === '') throw new ConnectError('', Code.Unauthenticated)
        yield rest.session.token.value
        stop.abort()
      },
      (message) => taken.push(message),
    )
    await vi.advanceTimersByTimeAsync(60_000)
    expect(opened).toBe(1)
    expect(rest.session.wanted.value).toContain('token')
    rest.session.give(' secret ')
    await vi.runAllTimersAsync()
    await read
    expect(taken).toEqual(['secret'])
    expect(rest.session.wanted.value).toBeUndefined()
  })
})

describe('keepAsking', () => {
  beforeEach(() => void vi.useFakeTimers())
  afterEach(() => void vi.useRealTimers())

  it('asks until there is an answer', async () => {
    let asked = 0
    const answer = keepAsking(upkeep(), async () => {
      asked += 1
      if (asked < 3) throw gone()
      return 'yes'
    })
    await vi.runAllTimersAsync()
    expect(await answer).toBe('yes')
    expect(asked).toBe(3)
  })

  it('throws what stays as it is', async () => {
    const refused = new ConnectError('too many', Code.ResourceExhausted)
    await expect(keepAsking(upkeep(), () => Promise.reject(refused))).rejects.toBe(refused)
  })
})

describe('sleep', () => {
  it('ends with the signal', async () => {
    const stop = new AbortController()
    const slept = sleep(60_000, stop.signal)
    stop.abort()
    await slept
  })
})
