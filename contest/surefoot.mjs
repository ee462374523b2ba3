// Runs the binary of Surefoot, and reads what it exports.

import { execFileSync } from 'node:child_process'

/** A function that runs `surefoot` with arguments, and returns what it prints on stdout. */
export function runner(surefoot) {
  const options = { encoding: 'utf8', maxBuffer: 1 << 30, stdio: ['ignore', 'pipe', 'ignore'] }
  return (...args) => execFileSync(surefoot, args, options)
}

/** Detour connects the end of a link to ground within the link's radius; graphs have finer vertices than a NavMesh has cells. */
const SMALLEST_RADIUS_IN_CELLS = 4

/**
 * The links of `surefoot graph export --format detour` as recast-navigation takes them. `by` is the move along the link in the terms of the
 * challenge, and `seconds` is what it is expected to take, failures included.
 */
export function provedLinks(exported, cell) {
  const moves = new Map(exported.legend.map(({ ability, area }) => [area, ability === 'drop' ? 'walk' : ability]))
  const point = (at) => {
    const [x, y, z] = exported.offMeshConVerts.slice(at, at + 3)
    return { x, y, z }
  }
  return exported.offMeshConRad.map((radius, link) => ({
    startPosition: point(6 * link),
    endPosition: point(6 * link + 3),
    radius: Math.max(radius, SMALLEST_RADIUS_IN_CELLS * cell),
    bidirectional: exported.offMeshConDir[link] === 1,
    by: moves.get(exported.offMeshConAreas[link]),
    seconds: exported.offMeshConSeconds[link],
  }))
}

/** How many times as long a proved link takes as running as far at `speed`, m/s. */
export function price({ startPosition, endPosition, seconds }, speed) {
  const { x, y, z } = endPosition
  return (seconds * speed) / Math.hypot(x - startPosition.x, y - startPosition.y, z - startPosition.z)
}
