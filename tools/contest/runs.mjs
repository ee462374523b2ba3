// Files of runs for `surefoot challenge`, map by map.

import { existsSync, readFileSync, writeFileSync } from 'node:fs'
import { cpus } from 'node:os'

export const VERSION_OF_RECAST = '0.43.1'

/** The description of an entrant on a NavMesh of an agent: `what` says what it is. */
export function aboutDetour(what, { cs, walkableRadius, walkableClimb, ch, walkableSlopeAngle }) {
  const metres = (cells, side) => `${+(cells * side).toFixed(2)} m`
  return [
    `Recast and Detour ${VERSION_OF_RECAST} (WebAssembly) ${what}`,
    `cells of ${cs} m, radius ${metres(walkableRadius, cs)}, climb ${metres(walkableClimb, ch)}, slope ${walkableSlopeAngle.toFixed(0)} degrees`,
    `Node.js ${process.version} on ${cpus()[0]?.model ?? 'an unknown processor'}`,
  ].join('; ')
}

/** Adds a map to the file of an entrant: what the file has for the other maps of the same set stays. */
export function record(file, { set, challenge }, { entrant, about }, { name, build_s, bytes, attempts }) {
  const earlier = existsSync(file) ? JSON.parse(readFileSync(file, 'utf8')) : { maps: [] }
  const isOfThisSet = earlier.set === set && earlier.challenge === challenge
  const others = isOfThisSet ? earlier.maps.filter((map) => map.name !== name) : []
  writeFileSync(file, JSON.stringify({ challenge, set, entrant, about, maps: [...others, { name, build_s, bytes, attempts }] }))
}
