import { create } from '@bufbuild/protobuf'
import { Code, ConnectError, createClient, createRouterTransport } from '@connectrpc/connect'
import { beforeEach, describe, expect, it, vi } from 'vitest'
import type { Context } from '../../src/data/context'
import { Link } from '../../src/data/net/link'
import { Session } from '../../src/data/net/session'
import { Toasts } from '../../src/data/toasts'
import { isDiverted } from '../../src/data/world/npcs'
import { nextChaser, OwnPlayer, posesOf } from '../../src/data/world/player'
import { type PlayerMove, PlayerSchema } from '../../src/gen/surefoot/world/v1/living_pb'
import { MapService } from '../../src/gen/surefoot/world/v1/maps_pb'
import { NpcSchema, NpcStatus, WorldService } from '../../src/gen/surefoot/world/v1/world_pb'
import { at } from '../view/builders'

/** Level ground. */
const cast = (origin: { y: number }, direction: { y: number }) => (direction.y < 0 ? origin.y : undefined)

describe('OwnPlayer', () => {
  let moves: PlayerMove[]
  let removed: number[]
  /** Refuses all calls with this. */
  let fault: ConnectError | undefined
  let toasts: Toasts
  let lost: number
  let player: OwnPlayer

  const refuse = () => {
    if (fault !== undefined) throw fault
  }
  const transport = createRouterTransport(({ service }) => {
    service(WorldService, {
      spawnPlayer: () => {
        refuse()
        return { playerId: 7 }
      },
      movePlayers: ({ moves: some }) => {
        refuse()
        moves.push(...some)
        return {}
      },
      removePlayer: ({ playerId }) => {
        removed.push(playerId)
        return {}
      },
    })
  })

  beforeEach(() => {
    ;[moves, removed, fault, lost, toasts] = [[], [], undefined, 0, new Toasts()]
    const session = new Session('http://127.0.0.1:7600', undefined)
    const side = { address: '', isForeign: false, session, link: new Link(), maps: createClient(MapService, transport) }
    const context: Context = {
      world: { ...side, calls: createClient(WorldService, transport) },
      planner: {} as Context['planner'],
      toasts,
      store: undefined,
      signal: new AbortController().signal,
    }
    player = new OwnPlayer(context, () => (lost += 1))
  })

  const texts = () => toasts.shown.value.map(({ text }) => text)

  it('is put down by the first click and walks to the next', async () => {
    await player.click(1n, at(0, 0, 0))
    expect(player.body.value).toEqual({ worldId: 1n, playerId: 7 })
    await player.click(1n, at(0.5, 0, 0))
    for (let picture = 0; picture < 60; picture += 1) player.step(undefined, false, 1 / 60, cast)
    expect(player.at.value?.x).toBeCloseTo(0.5, 0)
    // The last message says where it stands.
    await vi.waitFor(() => expect(moves.at(-1)?.velocity).toMatchObject(at(0, 0, 0)))
    expect(moves.at(-1)?.position?.x).toBeCloseTo(player.at.value!.x)
  })

  it('sends at most 30 places a second, and none while it stands', async () => {
    await player.click(1n, at(0, 0, 0))
    vi.useFakeTimers()
    for (let picture = 0; picture < 120; picture += 1) {
      player.step({ x: 3, z: 0 }, false, 1 / 120, cast)
      await vi.advanceTimersByTimeAsync(1000 / 120)
    }
    expect(moves.length).toBeGreaterThan(20)
    expect(moves.length).toBeLessThanOrEqual(30)
    player.stand()
    await vi.advanceTimersByTimeAsync(100)
    expect(moves.at(-1)?.velocity).toMatchObject(at(0, 0, 0))
    const { length } = moves
    player.step(undefined, false, 1 / 60, cast)
    await vi.advanceTimersByTimeAsync(100)
    expect(moves).toHaveLength(length)
    vi.useRealTimers()
  })

  it('says why it cannot be put down', async () => {
    fault = new ConnectError('the world has 1024 players', Code.ResourceExhausted)
    await player.click(1n, at(0, 0, 0))
    fault = new ConnectError('role viewer', Code.PermissionDenied)
    await player.click(1n, at(0, 0, 0))
    expect(texts()).toEqual([
      'No player was put there: The world has 1024 players.',
      'No player was put there: Your token does not allow this.',
    ])
    expect(player.isThere.value).toBe(false)
  })

  it('is lost when it cannot be moved, and says so once', async () => {
    await player.click(1n, at(0, 0, 0))
    fault = new ConnectError('no such player', Code.NotFound)
    for (let picture = 0; picture < 5; picture += 1) player.step({ x: 3, z: 0 }, false, 1 / 60, cast)
    await vi.waitFor(() => expect(lost).toBe(1))
    expect(player.isThere.value).toBe(false)
    expect(texts()).toEqual(['The player cannot be moved: No such player.'])
  })

  it('is removed, also if it was not even there', async () => {
    await player.click(1n, at(0, 0, 0))
    player.remove()
    expect(player.at.value).toBeUndefined()
    await vi.waitFor(() => expect(removed).toEqual([7]))
    const putting = player.click(1n, at(0, 0, 0))
    player.remove()
    await putting
    expect(player.isThere.value).toBe(false)
    await vi.waitFor(() => expect(removed).toEqual([7, 7]))
  })
})

describe('posesOf', () => {
  it('shows the own player where the page has it', () => {
    const players = [1, 2].map((playerId) =>
      create(PlayerSchema, { playerId, position: at(playerId, 0, 0), radius: 0.4, height: 2 }),
    )
    const own = { worldId: 1n, playerId: 2 }
    expect(posesOf(players, own, at(5, 0, 0)).map(({ position }) => position.x)).toEqual([1, 5])
    expect(posesOf(players, undefined, undefined).map(({ position }) => position.x)).toEqual([1, 2])
  })
})

describe('nextChaser', () => {
  const npc = (npcId: bigint, x: number, status = NpcStatus.IDLE) =>
    create(NpcSchema, { npcId, position: at(x, 0, 0), status })
  const npcs = new Map([npc(1n, 9), npc(2n, 4), npc(3n, 1, NpcStatus.DOWN)].map((it) => [it.npcId, it]))

  it.each([
    ['the nearest that is not down', undefined, [], 2n],
    ['the selected one', 1n, [], 1n],
    ['the next after one that chases', undefined, [2n], 1n],
    ['another than the selected one that chases', 1n, [1n], 2n],
    ['another than the selected one that is down', 3n, [], 2n],
    ['none where all chase', undefined, [1n, 2n], undefined],
  ])('is %s', (_, selected, chasers, expected) => {
    expect(nextChaser(npcs, selected, at(0, 0, 0), new Set(chasers))?.npcId).toBe(expected)
  })
})

describe('isDiverted', () => {
  it.each([
    ['follows the player', NpcStatus.SEEKING, at(2, 9, 0), false],
    ['has another goal', NpcStatus.SEEKING, at(9, 0, 0), true],
    ['waits for its next try', NpcStatus.IDLE, undefined, false],
  ])('an NPC that %s', (_, status, goal, expected) => {
    const npc = goal === undefined ? create(NpcSchema, { status }) : create(NpcSchema, { status, goal })
    expect(isDiverted(npc, at(0, 0, 0))).toBe(expected)
  })
})
