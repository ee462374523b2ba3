// Runs the binary of Surefoot, and reads what it exports.

import { execFileSync } from 'node:child_process'

/** A function that runs `surefoot` with arguments, and returns what it prints on stdout. */
export function runner(surefoot) {
  const options = { encoding: 'utf8', maxBuffer: 1 << 30, stdio: ['ignore', 'pipe', 'ignore'] }
  return (...args) => execFileSync(surefoot, args, options)
}

/** Detour connects the end of a link to ground within the link's radius; leaps begin and end nearer to ledges than a NavMesh gets. */
const SMALLEST_RADIUS_IN_CELLS = 4
/** Share of a plain controller's tries that a link is thought to succeed in at least. */
const LEAST_DRIVEN = 1 / 16
/** What a failure costs, s: those who miss a leap are somewhere else, and often cannot come back. */
const FAILURE_SECONDS = 30

/**
 * The links of `surefoot graph export --format detour` as recast-navigation takes them. `by` is the most demanding move along the link in the
 * terms of the challenge, `steps` are the places that a body goes through with the move to each, and `seconds` is what the link is expected to
 * take a plain controller, failures included.
 */
export function provedLinks(exported, cell) {
  const moves = new Map(exported.legend.map(({ ability, area }) => [area, moveOf(ability)]))
  const ends = exported.offMeshConVerts
  return exported.offMeshConRad.map((radius, link) => {
    const [start, end] = [ends.slice(6 * link, 6 * link + 3), ends.slice(6 * link + 3, 6 * link + 6)]
    const driven = Math.max(exported.offMeshConDriven[link], LEAST_DRIVEN)
    return {
      startPosition: point(start),
      endPosition: point(end),
      radius: Math.max(radius, SMALLEST_RADIUS_IN_CELLS * cell),
      bidirectional: exported.offMeshConDir[link] === 1,
      by: moves.get(exported.offMeshConAreas[link]),
      steps: stepsAlong(start, exported.offMeshConLeaps[link], end),
      seconds: exported.offMeshConSeconds[link] / driven - FAILURE_SECONDS * Math.log(driven),
    }
  })
}

function point([x, y, z]) {
  return { x, y, z }
}

function moveOf(ability) {
  return ability === 'drop' ? 'walk' : ability
}

/** The places of a link in the challenge's format: walk to each take-off, and leap to its landing. */
function stepsAlong(start, leaps, end) {
  const steps = [{ at: start, by: 'walk' }]
  const walk = (at) => {
    if (steps.at(-1).at.some((value, axis) => value !== at[axis])) steps.push({ at, by: 'walk' })
  }
  for (const { ability, take_off, landing } of leaps) {
    walk(take_off)
    steps.push({ at: landing, by: moveOf(ability) })
  }
  walk(end)
  return steps
}

/** How many times as long a proved link takes as running as far at `speed`, m/s. */
export function price({ startPosition, endPosition, seconds }, speed) {
  const { x, y, z } = endPosition
  return (seconds * speed) / Math.hypot(x - startPosition.x, y - startPosition.y, z - startPosition.z)
}
