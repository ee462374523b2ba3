// Where NPCs of a server will be, from the predictions of their workers.

import type { Npc } from '../gen/surefoot/world/v1/world_pb.ts'
import { add, scale, subtract, type Vec3 } from '../vec3.ts'

/** Where a character is and which way it faces. */
export interface Pose {
  /** Place of the feet, m. */
  position: Vec3
  /** Heading, rad. */
  yaw: number
}

/**
 * The pose of an NPC of a snapshot, some ticks of 1/60 s after the snapshot's tick, on a straight line between the
 * poses that are known. Undefined where the prediction does not reach so far.
 */
export function poseAt(npc: Npc, tick: bigint, ticks: number): Pose | undefined {
  const prediction = npc.movement?.prediction
  const age = Number(tick - (prediction?.tick ?? tick))
  const ahead = [prediction?.in20Ticks, prediction?.in40Ticks, prediction?.in60Ticks].map((pose, idx) => ({
    pose,
    at: 20 * (idx + 1) - age,
  }))
  const known = [{ pose: npc, at: 0 }, ...ahead].filter(({ at }) => at >= 0)
  const next = known.findIndex(({ at }) => at >= ticks)
  if (next < 0) return undefined
  const [from, to] = [known[Math.max(next - 1, 0)]!, known[next]!]
  const [a, b] = [from.pose, to.pose]
  if (a?.position === undefined || b?.position === undefined) return undefined
  const share = to.at > from.at ? (ticks - from.at) / (to.at - from.at) : 1
  const turn = b.yaw - a.yaw
  const yaw = a.yaw + share * Math.atan2(Math.sin(turn), Math.cos(turn))
  return { position: add(a.position, scale(subtract(b.position, a.position), share)), yaw }
}
