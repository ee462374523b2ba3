// The player that the user of the page moves.

import { batch, computed, signal } from '@preact/signals'
import { type Player, PlayerContact } from '../../gen/surefoot/world/v1/living_pb'
import { type Npc, NpcStatus } from '../../gen/surefoot/world/v1/world_pb'
import type { Place, PlayerPose } from '../../view/viewport.types'
import { type Context, report } from '../context'
import { sleep } from '../net/backoff'
import { type Failure, failureOf } from '../net/errors'
import { isSame } from './npcs'
import type { NpcsById } from './snapshot'
import { type Cast, type Level, STILL, speedOf, velocityTowards, walk } from './walk'

/** Pause after each message of where the player is, ms: at most 30 are sent a second. */
const SEND_MS = 34
const REST: Place = { x: 0, y: 0, z: 0 }
/** A player that is sent somewhere stops where a wall leaves it less than this share of its way. */
const LEAST_SHARE = 0.25

/** The player as the server knows it. */
export interface Body {
  worldId: bigint
  playerId: number
}

/** With these failures, there is no player left, or the page says already that the service is gone. */
const MAY_BE_GONE: ReadonlySet<Failure> = new Set(['missing', 'gone'])
/** Size of the player, m. */
const SIZE = { radius: 0.3, height: 1.8 }

/** All players; the own one where it is by now, which is ahead of what the server says. */
export function posesOf(players: readonly Player[], own: Body | undefined, at: Place | undefined): PlayerPose[] {
  const others = players.filter(({ playerId }) => playerId !== own?.playerId)
  const poses = others.map(({ position = REST, radius, height }) => ({ position, radius, height }))
  return at === undefined ? poses : [...poses, { position: at, ...SIZE }]
}

/** The NPC that chases the player next: the selected one, otherwise the nearest; none that chases it already or is down. */
export function nextChaser(
  npcs: NpcsById,
  selected: bigint | undefined,
  at: Place,
  chasers: Pick<ReadonlySet<bigint>, 'has'>,
): Npc | undefined {
  const able = [...npcs.values()].filter(({ npcId, status }) => status !== NpcStatus.DOWN && !chasers.has(npcId))
  const chosen = able.find(({ npcId }) => npcId === selected)
  return chosen ?? able.sort((a, b) => metresBetween(a.position, at) - metresBetween(b.position, at))[0]
}

export function metresBetween(a: Place | undefined, b: Place | undefined): number {
  return a === undefined || b === undefined ? Infinity : Math.hypot(a.x - b.x, a.y - b.y, a.z - b.z)
}

export class OwnPlayer {
  /** Where it is; undefined: there is no player. */
  readonly at = signal<Place | undefined>(undefined)
  readonly body = signal<Body | undefined>(undefined)
  readonly isThere = computed(() => this.body.value !== undefined)
  /** Where a click sends it. */
  private target: Place | undefined
  private velocity = REST
  /** Whether the server has the latest place and velocity. */
  private isSent = true
  private sending = false
  /** What is under way belongs to a player that was removed if this has changed. */
  private life = 0
  private putting = false

  constructor(
    private readonly context: Context,
    /** Called when the server no longer moves the player. */
    private readonly onLost: () => void,
  ) {}

  /** A click on the ground: puts the player there, or lets it walk there. */
  async click(worldId: bigint, at: Place): Promise<void> {
    if (this.isThere.peek()) this.target = at
    else await this.put(worldId, at)
  }

  /** Moves the player on, by keys or to where it was sent. Returns by how much. */
  step(keys: Level | undefined, isRunning: boolean, seconds: number, cast: Cast): Place {
    const from = this.at.peek()
    if (from === undefined || seconds <= 0) return REST
    if (keys !== undefined) this.target = undefined
    const level = keys ?? this.towardsTarget(from, isRunning, seconds)
    const to = walk(from, level, seconds, cast)
    const moved = { x: to.x - from.x, y: to.y - from.y, z: to.z - from.z }
    const asked = Math.hypot(level.x, level.z) * seconds
    if (Math.hypot(moved.x, moved.z) < asked * LEAST_SHARE) this.target = undefined
    // Steps are taken at once: they say nothing about how fast the player goes up or down.
    this.note(to, { x: moved.x / seconds, y: 0, z: moved.z / seconds })
    return moved
  }

  /** Lets the player stand. */
  stand(): void {
    const at = this.at.peek()
    this.target = undefined
    if (at !== undefined) this.note(at, REST)
  }

  /** Takes the player out of its world. */
  remove(): void {
    const body = this.body.peek()
    this.forget()
    if (body !== undefined) void this.takeOut(body)
  }

  private towardsTarget(from: Place, isRunning: boolean, seconds: number): Level {
    const level = this.target && velocityTowards(from, this.target, speedOf(isRunning), seconds)
    if (level === undefined) this.target = undefined
    return level ?? STILL
  }

  private async put(worldId: bigint, at: Place): Promise<void> {
    if (this.putting) return
    this.putting = true
    const { life } = this
    try {
      const request = { worldId, position: at, ...SIZE, contact: PlayerContact.PUSH }
      const { playerId } = await this.context.world.calls.spawnPlayer(request)
      const body = { worldId, playerId }
      if (life !== this.life) return void this.takeOut(body)
      batch(() => {
        this.body.value = body
        this.at.value = at
      })
    } catch (error) {
      report(this.context, 'No player was put there', error)
    } finally {
      this.putting = false
    }
  }

  /** Keeps where the player is, and sends it if that is new. */
  private note(at: Place, velocity: Place): void {
    const before = this.at.peek()
    if (before !== undefined && isSame(at, before) && isSame(velocity, this.velocity)) return
    this.at.value = at
    this.velocity = velocity
    this.isSent = false
    void this.sendAll()
  }

  /** Sends where the player is until the server has the latest place. */
  private async sendAll(): Promise<void> {
    if (this.sending) return
    this.sending = true
    for (let body = this.body.peek(); body !== undefined && !this.isSent; body = this.body.peek()) {
      const [position, velocity, life] = [this.at.peek(), this.velocity, this.life]
      this.isSent = true
      try {
        const moves = [{ playerId: body.playerId, position, velocity }]
        await this.context.world.calls.movePlayers({ worldId: body.worldId, moves })
      } catch (error) {
        if (life === this.life) this.lose(error)
      }
      await sleep(SEND_MS, this.context.signal)
    }
    this.sending = false
  }

  private lose(error: unknown): void {
    report(this.context, 'The player cannot be moved', error)
    this.remove()
    this.onLost()
  }

  private forget(): void {
    this.life += 1
    this.target = undefined
    this.isSent = true
    this.velocity = REST
    batch(() => {
      this.body.value = undefined
      this.at.value = undefined
    })
  }

  private async takeOut({ worldId, playerId }: Body): Promise<void> {
    try {
      await this.context.world.calls.removePlayer({ worldId, playerId })
    } catch (error) {
      if (!MAY_BE_GONE.has(failureOf(error))) report(this.context, 'The player was not removed', error)
    }
  }
}
