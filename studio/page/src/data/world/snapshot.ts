// What is known of a world's NPCs, kept up to date by snapshots and changes.

import {
  type Npc,
  type NpcDelta,
  NpcStatus,
  type WatchWorldResponse,
  type WorldStats,
} from '../../gen/surefoot/world/v1/world_pb'
import type { NpcPose, NpcState, Place } from '../../view/viewport.types'

export type NpcsById = ReadonlyMap<bigint, Npc>

/** What is known after a message: all of the region, or what was known with the changes. */
export function afterSnapshot(known: NpcsById, message: WatchWorldResponse): NpcsById {
  const next = new Map(message.isDelta ? known : [])
  for (const npc of message.npcs) next.set(npc.npcId, npc)
  for (const delta of message.changed) {
    const npc = next.get(delta.npcId)
    if (npc !== undefined) next.set(delta.npcId, afterDelta(npc, delta))
  }
  for (const id of message.goneNpcIds) next.delete(id)
  return next
}

/** An NPC after a change: what the change does not name stays. */
function afterDelta(npc: Npc, delta: NpcDelta): Npc {
  const { goalCleared, waypointCleared } = delta
  const next: Npc = {
    ...npc,
    position: delta.position ?? npc.position,
    velocity: delta.velocity ?? npc.velocity,
    yaw: delta.yaw ?? npc.yaw,
    status: delta.status ?? npc.status,
    goal: delta.goal ?? npc.goal,
    waypoint: delta.waypoint ?? npc.waypoint,
    lastOutcome: delta.lastOutcome ?? npc.lastOutcome,
    attemptsBegun: delta.attemptsBegun ?? npc.attemptsBegun,
    attemptsEnded: delta.attemptsEnded ?? npc.attemptsEnded,
    workerId: delta.workerId ?? npc.workerId,
    support: delta.support ?? npc.support,
    ability: delta.ability ?? npc.ability,
    cause: delta.cause ?? npc.cause,
    standing: delta.standing ?? npc.standing,
    route: delta.route ?? npc.route,
    routeStop: delta.routeStop ?? npc.routeStop,
  }
  if (goalCleared) delete next.goal
  if (waypointCleared) delete next.waypoint
  return next
}

const ORIGIN: Place = { x: 0, y: 0, z: 0 }

export function stateOf(npc: Npc): NpcState {
  if (npc.status === NpcStatus.SEEKING) return 'seeking'
  return npc.status === NpcStatus.DOWN ? 'down' : 'idle'
}

export function poseOf(npc: Npc): NpcPose {
  return {
    id: npc.npcId,
    position: npc.position ?? ORIGIN,
    velocity: npc.velocity ?? ORIGIN,
    yaw: npc.yaw,
    state: stateOf(npc),
    goal: npc.goal,
  }
}

/** NPCs by what they are doing. */
export function countStates(npcs: NpcsById): Record<NpcState, number> {
  const counts = { idle: 0, seeking: 0, down: 0 }
  for (const npc of npcs.values()) counts[stateOf(npc)] += 1
  return counts
}

/** Number of an NPC within its world: what people call it. */
export function npcNumber(id: bigint): string {
  return String(id & 0xfff_ffffn)
}

/** The NPCs that a search finds, by number: digits find numbers, words find states. */
export function findNpcs(npcs: NpcsById, text: string): Npc[] {
  const wanted = text.trim().toLowerCase()
  const found = [...npcs.values()].filter(
    (npc) => wanted === '' || npcNumber(npc.npcId).startsWith(wanted) || stateOf(npc).startsWith(wanted),
  )
  return found.sort((a, b) => (a.npcId < b.npcId ? -1 : 1))
}

/** Counters at a moment. */
export interface StatsSample {
  atMs: number
  stats: WorldStats
}

/** What the dashboard shows of a world. */
export interface Health {
  decisionsPerSecond: number | undefined
  /** Of the decisions asked for of late, 0 to 1. */
  inTime: number | undefined
  /** Of all attempts that have ended, 0 to 1. */
  success: number | undefined
  attempts: number
}

/** Rates between the first and the last sample, and totals at the last. */
export function healthOf(samples: readonly StatsSample[]): Health {
  const [first, last] = [samples[0], samples.at(-1)]
  if (first === undefined || last === undefined) {
    return { decisionsPerSecond: undefined, inTime: undefined, success: undefined, attempts: 0 }
  }
  const { stats } = last
  const seconds = (last.atMs - first.atMs) / 1000
  const answered = Number(stats.decisionsAnswered - first.stats.decisionsAnswered)
  const missed = Number(stats.decisionsMissed - first.stats.decisionsMissed)
  const attempts = Number(
    stats.reached + stats.fell + stats.burnt + stats.drowned + stats.noProgress + stats.unreachable,
  )
  return {
    decisionsPerSecond: seconds > 0 ? answered / seconds : undefined,
    inTime: answered + missed > 0 ? answered / (answered + missed) : undefined,
    success: attempts > 0 ? Number(stats.reached) / attempts : undefined,
    attempts,
  }
}
