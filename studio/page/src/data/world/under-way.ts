// Which NPC is worth watching.

import { type Npc, NpcStatus } from '../../gen/surefoot/world/v1/world_pb'
import type { NpcsById } from './snapshot'

/** NPCs under way to a goal, only those with a plan if there are any; all NPCs if none is under way. */
function worthWatching(npcs: NpcsById): Npc[] {
  const all = [...npcs.values()]
  const seeking = all.filter(({ status, goal }) => status === NpcStatus.SEEKING && goal !== undefined)
  const planned = seeking.filter(({ waypoint }) => waypoint !== undefined)
  return [planned, seeking, all].find((some) => some.length > 0) ?? []
}

function metresToGo({ position, goal }: Npc): number {
  return position === undefined || goal === undefined ? 0 : Math.hypot(goal.x - position.x, goal.z - position.z)
}

/** The NPC under way that has farthest to go, so that it stays under way for long; undefined: none is under way. */
export function npcToOpenOn(npcs: NpcsById): Npc | undefined {
  const [first, ...others] = worthWatching(npcs).filter(({ status }) => status === NpcStatus.SEEKING)
  if (first === undefined) return undefined
  return others.reduce((best, npc) => (metresToGo(npc) > metresToGo(best) ? npc : best), first)
}

/** The NPC to watch after another one, in the order of their ids; undefined: there are none. */
export function npcAfter(npcs: NpcsById, id: bigint | undefined): Npc | undefined {
  const sorted = worthWatching(npcs).sort((a, b) => (a.npcId < b.npcId ? -1 : 1))
  return sorted.find(({ npcId }) => id !== undefined && npcId > id) ?? sorted[0]
}
