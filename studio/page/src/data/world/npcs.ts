// The selected NPC, and what can be done with NPCs.

import { batch, signal } from '@preact/signals'
import {
  type AttemptEnded,
  type FollowNpcResponse,
  type Npc,
  type NpcPlan,
  NpcStatus,
  type Ray,
} from '../../gen/surefoot/world/v1/world_pb'
import type { Place } from '../../view/viewport.types'
import { type Context, report } from '../context'
import { failureOf } from '../net/errors'
import { keepReading } from '../net/stream'
import { npcNumber, type NpcsById } from './snapshot'

const RATE_HZ = 10
/** An NPC that chases the player has caught up at this distance, m. */
const CHASE_RADIUS_M = 1.5
/** The goal of an NPC that chases the player is never farther from it than this, m. */
const DIVERTED_M = 5
/** Snapshots that are older than an order have arrived after so long, ms. */
const SETTLED_MS = 1000
/** A stream that is silent for so long is taken for dead. */
const IDLE_MS = 10_000

/** What is known of the NPC that is followed. */
export interface Followed {
  id: bigint
  npc: Npc | undefined
  plan: NpcPlan | undefined
  waypointIdx: number
  eyes: Place | undefined
  rays: readonly Ray[]
  history: readonly AttemptEnded[]
}

/** What is known after a message: plan and history are only sent when they have changed. */
export function afterMessage(known: Followed, message: FollowNpcResponse): Followed {
  return {
    id: known.id,
    npc: message.npc ?? known.npc,
    plan: message.plan ?? known.plan,
    waypointIdx: headingOf(known, message),
    eyes: message.eyes,
    rays: message.rays,
    history: message.history.length > 0 ? message.history : known.history,
  }
}

/**
 * Index of the waypoint of its plan that an NPC heads for. While it heads for a point off its plan, as it does to get
 * out of the way of others, the message names the last waypoint, and the one that is known stays.
 */
function headingOf(known: Followed, { npc, plan, waypointIdx }: FollowNpcResponse): number {
  const [to, named] = [npc?.waypoint, (plan ?? known.plan)?.waypoints[waypointIdx]]
  const isOnPlan = to === undefined ? npc?.goal === undefined : named !== undefined && isSame(to, named)
  return isOnPlan ? waypointIdx : plan === undefined ? known.waypointIdx : 0
}

export const isSame = (a: Place, b: Place): boolean => a.x === b.x && a.y === b.y && a.z === b.z

/** Whether an NPC that chased the player has another goal now, as clients of the same world may give it. */
export function isDiverted({ status, goal }: Npc, player: Place | undefined): boolean {
  if (status !== NpcStatus.SEEKING || goal === undefined || player === undefined) return false
  return Math.hypot(goal.x - player.x, goal.z - player.z) > DIVERTED_M
}

export class Npcs {
  readonly selectedId = signal<bigint | undefined>(undefined)
  readonly followed = signal<Followed | undefined>(undefined)
  /** Whether the camera follows the selected NPC. */
  readonly camera = signal(false)
  /** NPCs that were sent to a goal so far. */
  readonly sent = signal(0)
  /** NPCs that chase the player, and when they were sent after it, ms. */
  readonly chasers = signal<ReadonlyMap<bigint, number>>(new Map())

  constructor(private readonly context: Context) {}

  select(id: bigint | undefined): void {
    batch(() => {
      if (id !== this.selectedId.value) this.camera.value = false
      this.selectedId.value = id
    })
  }

  /** Selects an NPC and follows it with the camera. */
  goAlong(id: bigint): void {
    batch(() => {
      this.selectedId.value = id
      this.camera.value = true
    })
  }

  toggleCamera(): void {
    if (this.selectedId.value !== undefined) this.camera.value = !this.camera.value
  }

  /** Follows the doings of an NPC until the signal aborts. */
  async follow(id: bigint, signal: AbortSignal): Promise<void> {
    const { world } = this.context
    const nothing: Followed = {
      id,
      npc: undefined,
      plan: undefined,
      waypointIdx: 0,
      eyes: undefined,
      rays: [],
      history: [],
    }
    this.followed.value = nothing
    const error = await keepReading(
      { link: world.link, session: world.session, signal },
      (signal) => world.calls.followNpc({ npcId: id, rateHz: RATE_HZ, rays: true }, { signal }),
      (message) => {
        const known = this.followed.peek()
        this.followed.value = afterMessage(known?.id === id ? known : nothing, message)
      },
      IDLE_MS,
    )
    if (error === undefined || signal.aborted) return
    if (failureOf(error) === 'missing') this.context.toasts.say(`NPC ${npcNumber(id)} was removed.`)
    else report(this.context, 'The NPC cannot be followed', error)
    if (this.selectedId.peek() === id) this.select(undefined)
  }

  async spawn(worldId: bigint, position: Place): Promise<bigint | undefined> {
    try {
      const yaw = Math.random() * 2 * Math.PI
      const { npcId } = await this.context.world.calls.spawnNpc({ worldId, position, yaw })
      this.select(npcId)
      return npcId
    } catch (error) {
      report(this.context, 'No NPC was spawned', error)
      return undefined
    }
  }

  async send(npcId: bigint, goal: Place): Promise<void> {
    try {
      await this.context.world.calls.setGoal({ npcId, goal })
      this.sent.value += 1
      this.forgetChasers([npcId])
    } catch (error) {
      report(this.context, `NPC ${npcNumber(npcId)} was not sent`, error)
    }
  }

  /** Lets an NPC chase a player of its world. */
  async chase(npcId: bigint, targetPlayerId: number): Promise<void> {
    try {
      const target = { case: 'targetPlayerId', value: targetPlayerId } as const
      await this.context.world.calls.setGoal({ npcId, target, radius: CHASE_RADIUS_M, keep: true })
      this.chasers.value = new Map([...this.chasers.peek(), [npcId, performance.now()]])
    } catch (error) {
      report(this.context, `NPC ${npcNumber(npcId)} does not chase the player`, error)
    }
  }

  /** Ends the chase of NPCs. */
  async stopChase(npcIds: readonly bigint[]): Promise<void> {
    this.forgetChasers(npcIds)
    if (npcIds.length === 0) return
    try {
      await this.context.world.calls.clearGoals({ npcIds: [...npcIds] })
    } catch (error) {
      report(this.context, 'The chase cannot be ended', error)
    }
  }

  /** Notes which NPCs no longer chase the player, which is `at` as the server has it. */
  noteChasers(npcs: NpcsById, at: Place | undefined): void {
    for (const [id, since] of this.chasers.peek()) {
      const npc = npcs.get(id)
      if (npc === undefined || npc.status === NpcStatus.DOWN) this.forgetChasers([id])
      else if (performance.now() - since > SETTLED_MS && isDiverted(npc, at)) {
        this.forgetChasers([id])
        this.context.toasts.say(`NPC ${npcNumber(id)} was sent elsewhere and no longer chases the player.`)
      }
    }
  }

  private forgetChasers(npcIds: readonly bigint[]): void {
    if (!npcIds.some((id) => this.chasers.peek().has(id))) return
    this.chasers.value = new Map([...this.chasers.peek()].filter(([id]) => !npcIds.includes(id)))
  }

  async teleport(npcId: bigint, position: Place, yaw: number): Promise<void> {
    try {
      await this.context.world.calls.teleportNpc({ npcId, position, yaw })
      this.forgetChasers([npcId])
    } catch (error) {
      report(this.context, `NPC ${npcNumber(npcId)} was not teleported`, error)
    }
  }

  async remove(npcId: bigint): Promise<void> {
    try {
      await this.context.world.calls.despawnNpc({ npcId })
      if (this.selectedId.value === npcId) this.select(undefined)
    } catch (error) {
      report(this.context, `NPC ${npcNumber(npcId)} was not removed`, error)
    }
  }
}
