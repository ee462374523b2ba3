// Builds the graph of a level of platforms over a void, exports its links, searches them in Detour, and writes what the check of landmass needs.
//
//   node platforms.mjs SUREFOOT FOLDER
//
// FOLDER gets `landmass.json`, the links, and `search.json`, the level, the vertices and the share of pairs that must be connected.

import assert from 'node:assert/strict'
import { readFileSync, writeFileSync } from 'node:fs'
import { join } from 'node:path'
import { init } from '@recast-navigation/core'
import { ground } from './level.mjs'
import { agentOf, Baked } from './navmesh.mjs'
import { PathFinder } from './paths.mjs'
import { provedLinks, runner } from './surefoot.mjs'
import { BODY, boxes } from './test/levels.mjs'

/** Low and high corners of the platforms: steps up that take a jump or two, gaps, and one from which only a drop leads away. */
const PLATFORMS = [
  [4, 20, 4, 16, 21, 16],
  [19, 20, 4, 31, 21, 16],
  [19, 20, 18.5, 31, 22.5, 30.5],
  [4, 20, 18, 16, 23.5, 30],
  [34, 20, 4, 46, 24.5, 16],
  [34, 10, 20, 46, 11, 32],
]
const BUILD = ['--vertices', '60', '--neighbours', '12']

const [surefoot, folder] = process.argv.slice(2)
const run = runner(surefoot)

/** The level as a Wavefront file. */
function obj({ positions, indices }) {
  const vertices = Array.from({ length: positions.length / 3 }, (_, at) => `v ${[...positions.subarray(3 * at, 3 * at + 3)].join(' ')}`)
  const faces = Array.from({ length: indices.length / 3 }, (_, at) => `f ${[...indices.subarray(3 * at, 3 * at + 3)].map((it) => it + 1).join(' ')}`)
  return [...vertices, ...faces].join('\n')
}

/** Exports in a format, and returns the file with what the exporter says of it. */
function exported(format, map) {
  const out = join(folder, `${format}.json`)
  const options = ['--format', format, '--cache', join(folder, 'cache'), ...BUILD, '--out', out]
  const summary = run('graph', 'export', map, ...options, ...(format === 'json' ? [] : ['--json']))
  return { file: JSON.parse(readFileSync(out, 'utf8')), summary: format === 'json' ? undefined : JSON.parse(summary) }
}

/** The share of ordered pairs of different places that are connected. */
function connected(places, leads) {
  const pairs = places.flatMap((from, at) => places.filter((_, other) => other !== at).map((to) => [from, to]))
  return pairs.filter(([from, to]) => leads(from, to)).length / pairs.length
}

/** The tops of the platforms on the axes of the map: importing moves a level to where maps begin. */
function tops({ positions }) {
  const least = [0, 1, 2].map((axis) => positions.filter((_, at) => at % 3 === axis).reduce((low, value) => Math.min(low, value)))
  const from = [0, 1, 2].map((axis) => Math.min(...PLATFORMS.map((platform) => platform[axis])))
  return PLATFORMS.map((platform) => platform.map((value, at) => value + least[at % 3] - from[at % 3]))
}

await init()
const [source, map, glb] = ['level.obj', 'level.sfmap', 'level.glb'].map((name) => join(folder, name))
writeFileSync(source, obj(boxes(...PLATFORMS.map(([x, y, z, ...high]) => [[x, y, z], high]))))
run('map', 'import', source, '--out', map)
run('map', 'export', map, '--out', glb)
const level = ground(readFileSync(glb))

const places = exported('json', map).file.nodes.map(({ x, y, z }) => [x, y, z])
const { file, summary } = exported('detour', map)
const agent = agentOf(BODY)
const baked = new Baked(level, agent, [])
const shares = [[], provedLinks(file, agent.cs)].map((links) => {
  const finder = new PathFinder(baked.navMesh(links), links)
  return connected(places, (start, goal) => finder.approach({ start, goal }).isComplete)
})
const { without, with: linked } = summary.connected
console.log(`Detour: ${shares.map((share) => (100 * share).toFixed(2)).join(' % and ')} % of pairs connected without and with ${summary.links} links`)
assert.deepEqual(shares, [without, linked], 'what Detour connects is what the exporter says')
assert.ok(without < 0.3 && linked > 2 * without, 'the links add something')

assert.deepEqual(exported('landmass', map).summary, summary)
writeFileSync(join(folder, 'search.json'), JSON.stringify({ platforms: tops(level), places, connected: summary.connected }))
