// How much of a level Recast and Detour connect by themselves, and with Surefoot's proved links as off-mesh connections.
//
//   npm ci && npm run contest -- ../../target/release/surefoot 7 level.glb other.obj
//
// Each level is a seed of a generated map or a file. Points are drawn on the NavMesh by area, always the same ones; a pair counts as
// connected if Detour finds a path that ends on the goal's polygon.

import { mkdtempSync, readFileSync, rmSync } from 'node:fs'
import { tmpdir } from 'node:os'
import { basename, join } from 'node:path'
import { init, NavMeshQuery, setRandomSeed } from '@recast-navigation/core'
import { generateSoloNavMesh } from '@recast-navigation/generators'
import { ground } from './level.mjs'
import { provedLinks, runner } from './surefoot.mjs'

const PAIRS = 1000
const CELL_M = 0.25
/** The agent, in cells: 1.8 m tall, steps of 0.4 m, a radius of 0.25 m. */
const AGENT = { walkableHeight: 8, walkableClimb: 2, walkableRadius: 1, walkableSlopeAngle: 50 }

const [surefoot, ...levels] = process.argv.slice(2)
if (surefoot === undefined || levels.length === 0) {
  console.error('usage: npm run contest -- SUREFOOT LEVEL...    (a seed, or a .glb, .gltf, .obj or .sfmap file)')
  process.exit(2)
}

const folder = mkdtempSync(join(tmpdir(), 'contest-'))
process.on('exit', () => rmSync(folder, { recursive: true }))
const run = runner(surefoot)

/** The solid triangles of a map, the links that its NavMesh needs, and all links of its graph. */
function describe(level) {
  let map = level
  if (/\.(glb|gltf|obj)$/i.test(level)) {
    map = join(folder, 'level.sfmap')
    run('map', 'import', level, '--out', map)
  }
  const glb = join(folder, 'level.glb')
  run('map', 'export', map, '--out', glb)
  const links = (...options) => provedLinks(JSON.parse(run('graph', 'export', map, '--format', 'detour', ...options)), CELL_M)
  return { ...ground(readFileSync(glb)), needed: links(), all: links('--all-links') }
}

function navMesh({ positions, indices }, offMeshConnections) {
  const config = { cs: CELL_M, ch: 0.2, ...AGENT, offMeshConnections }
  const { success, navMesh, error } = generateSoloNavMesh(positions, indices, config)
  if (!success) throw new Error(`Recast: ${error}`)
  return navMesh
}

/** Pairs of points, drawn on the NavMesh without links. */
function pairs(mesh) {
  setRandomSeed(1)
  const query = new NavMeshQuery(mesh)
  const point = () => query.findRandomPoint().randomPoint
  return Array.from({ length: PAIRS }, () => [point(), point()])
}

/** The share of pairs that Detour connects. */
function connected(mesh, pairs) {
  const query = new NavMeshQuery(mesh, { maxNodes: 65535 })
  const nearest = (at) => query.findNearestPoly(at, { halfExtents: { x: 0.5, y: 1, z: 0.5 } }).nearestRef
  const reached = pairs.filter(([start, goal]) => {
    const [from, to] = [nearest(start), nearest(goal)]
    const { polys } = query.findPath(from, to, start, goal, { maxPathPolys: 8192 })
    const isWhole = polys.size > 0 && polys.get(polys.size - 1) === to
    polys.destroy()
    return isWhole
  })
  return reached.length / pairs.length
}

await init()
const percent = (share) => `${(100 * share).toFixed(1)} %`
console.log(`| level | NavMesh alone | with links | with all links |\n|---|---|---|---|`)
for (const level of levels) {
  const description = describe(level)
  const alone = navMesh(description, [])
  const drawn = pairs(alone)
  const { needed, all } = description
  const [few, many] = [needed, all].map((links) => `${percent(connected(navMesh(description, links), drawn))} (${links.length})`)
  console.log(`| ${basename(level)} | ${percent(connected(alone, drawn))} | ${few} | ${many} |`)
}
