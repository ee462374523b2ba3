// How bodies move that follow Detour's paths: runs of a set for `surefoot challenge motion`.
//
//   npm ci && npm run motion -- SETDIR OUTDIR
//
// SETDIR comes from `surefoot challenge set NAME --out SETDIR`. OUTDIR gets three runs, in which only goals are answered that a complete path of
// Detour reaches without links:
//
// - detour.json: the paths, which a plain controller of Surefoot drives, and which are the shortest ones that are known;
// - detour-exact.json: tracks along these paths at a constant speed;
// - detour-crowd.json: tracks of one DetourCrowd agent for each goal.
//
// Bodies are those of the set. The heading of tracks turns to the direction of motion at the body's turn speed.

import { mkdirSync, readFileSync } from 'node:fs'
import { join } from 'node:path'
import { Crowd, init } from '@recast-navigation/core'
import { ground, volumes } from './level.mjs'
import { Baked, agentOf, priceAreas } from './navmesh.mjs'
import { PathFinder } from './paths.mjs'
import { aboutDetour, record } from './runs.mjs'
import { alongPath, crowdAgent, inCrowd } from './tracks.mjs'

const [setFolder, outFolder] = process.argv.slice(2)
if (outFolder === undefined) {
  console.error('usage: npm run motion -- SETDIR OUTDIR')
  process.exit(2)
}
const set = JSON.parse(readFileSync(join(setFolder, 'set.json'), 'utf8'))
const { radius, height, forward_speed: speed, turn_speed: turnSpeed } = set.body
const voxels = agentOf(set.body)
const agent = crowdAgent({ radius, height, speed })

/** The runs, each with the approach to a goal that the complete path of `found` reaches. */
const RUNS = {
  detour: { about: 'plain', approach: (_, { path }) => ({ path }) },
  'detour-exact': {
    about: `plain, at ${speed} m/s along the path`,
    approach: (goal, { path }) => ({ track: alongPath(goal, path.map(({ at }) => at), { speed, turnSpeed }) }),
  },
  'detour-crowd': {
    about: `with DetourCrowd, ${speed} m/s, ${agent.maxAcceleration.toFixed(0)} m/s2`,
    approach: (goal, { finder, crowd }) => {
      const [from, to] = [goal.start, goal.goal].map((place) => finder.nearest(place).at)
      return { track: inCrowd(crowd, goal, { from, to }, { agent, turnSpeed }) }
    },
  },
}

/** The attempts of all runs on a map. */
function attempts({ name, goals }) {
  const file = readFileSync(join(setFolder, `${name}.glb`))
  const baked = new Baked(ground(file), voxels, volumes(file))
  const navMesh = baked.navMesh([])
  const finder = new PathFinder(navMesh, [])
  const crowd = new Crowd(navMesh, { maxAgents: 1, maxAgentRadius: radius })
  priceAreas(crowd.getFilter(0))
  const found = goals.map((goal) => finder.approach(goal))
  const runs = Object.entries(RUNS).map(([entrant, { approach }]) => {
    const answers = goals.map((goal, index) => {
      const { isComplete, approach: { path } } = found[index]
      return isComplete ? approach(goal, { path, finder, crowd }) : 'unreachable'
    })
    return [entrant, answers]
  })
  crowd.destroy()
  finder.free()
  navMesh.destroy()
  baked.free()
  return Object.fromEntries(runs)
}

await init()
mkdirSync(outFolder, { recursive: true })
for (const map of set.maps) {
  const runs = attempts(map)
  for (const [entrant, { about }] of Object.entries(RUNS)) {
    const head = { entrant, about: aboutDetour(about, voxels) }
    record(join(outFolder, `${entrant}.json`), set, head, { name: map.name, build_s: 0, bytes: 0, attempts: runs[entrant] })
  }
  const complete = runs.detour.filter((attempt) => attempt !== 'unreachable').length
  console.log(`${map.name}: complete paths to ${complete} of ${map.goals.length} goals`)
}
process.exit(0)
