import { Ability } from '../../src/gen/surefoot/world/v1/map_pb'
import { Surface } from '../../src/gen/surefoot/world/v1/world_pb'
import type { GraphEdge, GraphFilter, MeshTile, NpcPose, Place } from '../../src/view/viewport.types'

export const at = (x: number, y: number, z: number): Place => ({ x, y, z })

/** Level ground of `side` m in squares of `step` m at a height that may depend on the place. */
export function groundTile(
  side: number,
  step: number,
  heightAt: (x: number, z: number) => number,
  surface = Surface.GROUND,
): MeshTile {
  const across = side / step + 1
  const positions: number[] = []
  const indices: number[] = []
  for (let z = 0; z < across; z += 1) {
    for (let x = 0; x < across; x += 1) {
      positions.push(x * step, heightAt(x * step, z * step), z * step)
      if (x + 1 < across && z + 1 < across) {
        const corner = z * across + x
        indices.push(corner, corner + across, corner + 1, corner + 1, corner + across, corner + across + 1)
      }
    }
  }
  return {
    tileX: 0,
    tileZ: 0,
    positions: Float32Array.from(positions),
    indices: Uint32Array.from(indices),
    surfaces: new Uint8Array(indices.length / 3).fill(surface),
  }
}

export const pose = (id: number, position: Place, velocity = at(0, 0, 0), yaw = 0): NpcPose => ({
  id: BigInt(id),
  position,
  velocity,
  yaw,
  state: 'seeking',
})

export const edge = (changes: Partial<GraphEdge> = {}): GraphEdge => ({
  from: 0,
  to: 1,
  ability: Ability.WALK,
  chance: 0.9,
  seconds: 2,
  priceFactor: 1,
  forced: false,
  oneWay: false,
  ...changes,
})

export const filter = (changes: Partial<GraphFilter> = {}): GraphFilter => ({
  presence: 'full',
  colour: 'chance',
  abilities: new Set([1, 2, 3, 4, 5, 6, 7] as Ability[]),
  minChance: 0,
  maxChance: 1,
  onlyOneWay: false,
  onlyEdited: false,
  ...changes,
})
