// What a studio would use, as entrants of the challenge: Recast and Detour plain, with automatic jump links, and with Surefoot's proved links.
//
//   npm ci && npm run compete -- ../../target/release/surefoot SETDIR OUTDIR [MAP...]
//
// SETDIR comes from `surefoot challenge set NAME --out SETDIR`. For each entrant OUTDIR gets a file for `surefoot challenge score`. If maps are
// named, only those are answered, and files that are there already keep what they have for the others.

import { mkdirSync, mkdtempSync, readFileSync, rmSync, writeFileSync } from 'node:fs'
import { tmpdir } from 'node:os'
import { join } from 'node:path'
import { exportNavMesh, init } from '@recast-navigation/core'
import { ground, volumes } from './level.mjs'
import { jumpLinks } from './links.mjs'
import { Baked, agentOf, areaOfPrice, boundary } from './navmesh.mjs'
import { PathFinder } from './paths.mjs'
import { aboutDetour, record } from './runs.mjs'
import { price, provedLinks, runner } from './surefoot.mjs'
import { Triangles } from './triangles.mjs'

/** Price of automatic links against walking as far. Agents then favour walking, and take a link where the walk is clearly longer. */
const JUMP_PRICE = 2

/** How each entrant gets its links. */
const ENTRANTS = {
  detour: { about: 'plain', links: () => [] },
  'detour-jumps': { about: 'with automatic one-way links down, across gaps and up', links: automaticLinks },
  'detour-links': { about: 'with the proved links of a Surefoot graph', links: graphLinks },
}

const [surefoot, setFolder, outFolder, ...chosen] = process.argv.slice(2)
if (outFolder === undefined) {
  console.error('usage: npm run compete -- SUREFOOT SETDIR OUTDIR [MAP...]')
  process.exit(2)
}
const set = JSON.parse(readFileSync(join(setFolder, 'set.json'), 'utf8'))
const unknown = chosen.find((name) => !set.maps.some((map) => map.name === name))
if (unknown !== undefined) {
  console.error(`the set has no map \`${unknown}\``)
  process.exit(2)
}
const agent = agentOf(set.body)

/** The seconds that a function takes, with what it returns. */
function timed(work) {
  const begin = performance.now()
  const result = work()
  return [result, (performance.now() - begin) / 1000]
}

/** Links that an engine would generate at the edges of the NavMesh. */
function automaticLinks({ level, plain }) {
  const finder = new PathFinder(plain, [])
  // Detour connects a landing to the NavMesh if it is this close: two cells, and a step up or down.
  const search = [{ x: 2 * agent.cs, y: agent.walkableClimb * agent.ch, z: 2 * agent.cs }]
  const nearest = (at) => finder.nearest(at, search)?.at
  const links = jumpLinks({ edges: boundary(plain), triangles: new Triangles(level), body: set.body, agent, nearest })
  finder.free()
  return links.map((link) => ({ ...link, area: areaOfPrice(JUMP_PRICE) }))
}

/** Links of a graph that is built for the purpose. */
function graphLinks({ name }) {
  const scratch = mkdtempSync(join(tmpdir(), 'compete-'))
  try {
    const body = join(scratch, 'body.toml')
    const fields = Object.entries(set.body).map(([field, value]) => `${field} = ${JSON.stringify(value)}\n`)
    writeFileSync(body, fields.join(''))
    const map = join(setFolder, `${name}.sfmap`)
    // A cache of its own, so that the time is that of building.
    const options = ['--format', 'detour', '--all-links', '--body', body, '--cache', join(scratch, 'cache')]
    const links = provedLinks(JSON.parse(runner(surefoot)('graph', 'export', map, ...options)), agent.cs)
    return links.map((link) => ({ ...link, area: areaOfPrice(price(link, set.body.forward_speed)) }))
  } finally {
    rmSync(scratch, { recursive: true })
  }
}

/** The runs of all entrants on a map. */
function compete({ name, goals }) {
  const file = readFileSync(join(setFolder, `${name}.glb`))
  const level = ground(file)
  const [baked, bakeSeconds] = timed(() => new Baked(level, agent, volumes(file)))
  const plain = baked.navMesh([])
  const runs = Object.entries(ENTRANTS).map(([entrant, { links: linksOf }]) => {
    const [links, linkSeconds] = timed(() => linksOf({ name, level, plain }))
    const [navMesh, joinSeconds] = timed(() => baked.navMesh(links))
    const answer = attempts(navMesh, links, goals)
    // The tile holds the links; what kind each is takes another byte.
    const bytes = exportNavMesh(navMesh).byteLength + links.length
    navMesh.destroy()
    return [entrant, { name, build_s: bakeSeconds + linkSeconds + joinSeconds, bytes, ...answer, links: links.length }]
  })
  plain.destroy()
  baked.free()
  return Object.fromEntries(runs)
}

function attempts(navMesh, links, goals) {
  const finder = new PathFinder(navMesh, links)
  const answers = goals.map((goal) => finder.approach(goal))
  const micros = answers.map((answer) => answer.micros).sort((a, b) => a - b)
  finder.free()
  const complete = answers.filter(({ isComplete }) => isComplete).length / goals.length
  return { attempts: answers.map(({ approach }) => approach), complete, queryMicros: micros[Math.floor(micros.length / 2)] }
}

await init()
mkdirSync(outFolder, { recursive: true })
console.log('| map | entrant | complete paths | links | build, s | bytes | query, us |\n|---|---|---|---|---|---|---|')
for (const map of set.maps.filter(({ name }) => chosen.length === 0 || chosen.includes(name))) {
  for (const [entrant, run] of Object.entries(compete(map))) {
    const { name, build_s, bytes, attempts } = run
    const head = { entrant, about: aboutDetour(ENTRANTS[entrant].about, agent) }
    record(join(outFolder, `${entrant}.json`), set, head, { name, build_s, bytes, attempts })
    const figures = [`${(100 * run.complete).toFixed(1)} %`, run.links, run.build_s.toFixed(2), run.bytes, run.queryMicros.toFixed(0)]
    console.log(`| ${[map.name, entrant, ...figures].join(' | ')} |`)
  }
}
