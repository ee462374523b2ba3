// Toy levels: boxes, and what is needed to generate links on them.

import { jumpLinks } from '../links.mjs'
import { Baked, agentOf, boundary } from '../navmesh.mjs'
import { PathFinder } from '../paths.mjs'
import { Triangles } from '../triangles.mjs'

/** The default body of Surefoot's characters, as far as a NavMesh needs it. */
export const BODY = {
  height: 1.8,
  radius: 0.3,
  forward_speed: 11,
  jump_speed: 10,
  gravity: 20,
  max_slope: (35 * Math.PI) / 180,
  step_height: 0.1,
}

const SIDES = [
  [0, 4, 6, 2],
  [1, 3, 7, 5],
  [0, 1, 5, 4],
  [2, 6, 7, 3],
  [0, 2, 3, 1],
  [4, 5, 7, 6],
]

/** Positions and indices of boxes, each from a low to a high corner. */
export function boxes(...corners) {
  const positions = []
  for (const [low, high] of corners) {
    for (const [a, b, c, d] of SIDES) {
      for (const corner of [a, b, c, a, c, d]) positions.push(...low.map((value, axis) => ((corner >> axis) & 1 ? high[axis] : value)))
    }
  }
  return { positions: Float32Array.from(positions), indices: Uint32Array.from(positions.keys()).slice(0, positions.length / 3) }
}

/** Links of a level, and the NavMesh with them. */
export function linked(level, body = BODY, volumes = []) {
  const agent = agentOf(body)
  const baked = new Baked(level, agent, volumes)
  const plain = baked.navMesh([])
  const finder = new PathFinder(plain, [])
  const nearest = (at) => finder.nearest(at, [{ x: 0.5, y: 0.4, z: 0.5 }])?.at
  const links = jumpLinks({ edges: boundary(plain), triangles: new Triangles(level), body, agent, nearest })
  return { links, finder: new PathFinder(baked.navMesh(links), links) }
}
