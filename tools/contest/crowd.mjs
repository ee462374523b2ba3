// How DetourCrowd gets on in two scenes of `surefoot eval --suite living`: 64 agents through a door of 1.2 m, and two streams of 64 in a corridor
// of 4 m.
//
//   npm ci && npm run crowd -- 10
//
// Same rooms, same numbers, same distances between starts and goals; agents with the body of our NPCs (radius 0.3 m, height 1.8 m, 11 m/s) and
// DetourCrowd's best obstacle avoidance. An agent has arrived once it has come within 1 m of its goal; who has not after two minutes has failed.

import { Crowd, init } from '@recast-navigation/core'
import { generateSoloNavMesh } from '@recast-navigation/generators'
import { crowdAgent } from './tracks.mjs'

const RUNS = Number(process.argv[2] ?? 10)
const TICK_S = 1 / 60
const LIMIT_S = 120
const APART = 1.7
const CELL_M = 0.1
const WALL_M = 9

/** Positions and indices of boxes, each from a low to a high corner. */
function mesh(boxes) {
  const positions = []
  const indices = []
  const quads = [
    [0, 4, 6, 2],
    [1, 3, 7, 5],
    [0, 1, 5, 4],
    [2, 6, 7, 3],
    [0, 2, 3, 1],
    [4, 5, 7, 6],
  ]
  for (const [low, high] of boxes) {
    for (const quad of quads) {
      for (const corner of [quad[0], quad[1], quad[2], quad[0], quad[2], quad[3]]) {
        indices.push(positions.length / 3)
        positions.push(...[0, 1, 2].map((axis) => ((corner >> axis) & 1 ? high : low)[axis]))
      }
    }
  }
  return { positions, indices }
}

const ground = ([x0, z0], [x1, z1]) => [
  [x0, -1, z0],
  [x1, 0, z1],
]
const wall = ([x0, z0], [x1, z1]) => [
  [x0, -1, z0],
  [x1, WALL_M, z1],
]

const ROOMS = [
  ground([2, 2], [44, 24]),
  wall([1, 1], [45, 2]),
  wall([1, 24], [45, 25]),
  wall([1, 2], [2, 24]),
  wall([44, 2], [45, 24]),
  wall([22.8, 2], [23.2, 12.4]),
  wall([22.8, 13.6], [23.2, 24]),
]
const CORRIDOR = [
  ground([2, 2], [104, 24]),
  wall([1, 1], [105, 2]),
  wall([1, 24], [105, 25]),
  wall([1, 2], [2, 24]),
  wall([104, 2], [105, 24]),
  wall([23, 2], [83, 11]),
  wall([23, 15], [83, 24]),
]

/** Numbers from 0 to 1 that a seed repeats (mulberry32). */
function randomOf(seed) {
  let state = seed >>> 0
  return () => {
    state = (state + 0x6d2b79f5) >>> 0
    let mixed = Math.imul(state ^ (state >>> 15), state | 1)
    mixed ^= mixed + Math.imul(mixed ^ (mixed >>> 7), mixed | 61)
    return ((mixed ^ (mixed >>> 14)) >>> 0) / 2 ** 32
  }
}

/** Places in rows on a rectangle, shuffled. */
function rows([x0, z0], [x1], count, random) {
  const perRow = Math.floor((x1 - x0) / APART)
  const places = Array.from({ length: count }, (_, at) => ({
    x: x0 + (at % perRow) * APART,
    y: 0,
    z: z0 + Math.floor(at / perRow) * APART,
  }))
  for (let at = count - 1; at > 0; at -= 1) {
    const other = Math.floor(random() * (at + 1))
    ;[places[at], places[other]] = [places[other], places[at]]
  }
  return places
}

function throughTheDoor(seed) {
  const random = randomOf(seed)
  const starts = rows([4, 6], [18, 20], 64, random)
  const goals = rows([28, 6], [42, 20], 64, random)
  return starts.map((start, at) => [start, goals[at]])
}

function streams(seed, both) {
  const random = randomOf(seed)
  const rooms = [
    [
      [4, 4],
      [19, 22],
    ],
    [
      [86, 4],
      [101, 22],
    ],
  ]
  const places = (room) => rows(...rooms[room], 64, random)
  const [starts, goals] = [places(0), places(1)]
  const ways = starts.map((start, at) => [start, goals[at]])
  if (!both) return ways
  const aside = ({ x, y, z }) => ({ x: x + APART / 2, y, z: z + APART / 2 })
  const [others, back] = [places(1).map(aside), places(0).map(aside)]
  return [...ways, ...others.map((start, at) => [start, back[at]])]
}

/** Runs agents until all have arrived, or time is up; returns how many have, and when the last one did, s. */
function run(navMesh, ways) {
  const crowd = new Crowd(navMesh, { maxAgents: ways.length, maxAgentRadius: 0.3 })
  const agents = ways.map(([start, goal]) => {
    const agent = crowd.addAgent(start, crowdAgent({ radius: 0.3, height: 1.8, speed: 11 }))
    agent.requestMoveTarget(goal)
    return { agent, goal, arrived: undefined }
  })
  for (let tick = 1; tick * TICK_S <= LIMIT_S; tick += 1) {
    crowd.update(TICK_S)
    for (const one of agents) {
      const { x, z } = one.agent.position()
      if (Math.hypot(x - one.goal.x, z - one.goal.z) <= 1) one.arrived ??= tick * TICK_S
    }
    if (agents.every(({ arrived }) => arrived !== undefined)) break
  }
  const times = agents.flatMap(({ arrived }) => arrived ?? [])
  crowd.destroy()
  return { arrived: times.length, last: Math.max(...times) }
}

await init()
const scenes = [
  ['64 through one door of 1.2 m', ROOMS, throughTheDoor],
  ['two streams of 64 in a corridor of 4 m', CORRIDOR, (seed) => streams(seed, true)],
  ['one stream of 64 in it', CORRIDOR, (seed) => streams(seed, false)],
]
for (const [name, boxes, ways] of scenes) {
  const { positions, indices } = mesh(boxes)
  const agent = { walkableHeight: 18, walkableClimb: 4, walkableRadius: 3, walkableSlopeAngle: 50 }
  const { success, navMesh, error } = generateSoloNavMesh(positions, indices, { cs: CELL_M, ch: CELL_M, ...agent })
  if (!success) throw new Error(error)
  let [arrived, wanted, complete, last] = [0, 0, 0, 0]
  for (let seed = 0; seed < RUNS; seed += 1) {
    const all = ways(seed)
    const result = run(navMesh, all)
    arrived += result.arrived
    wanted += all.length
    complete += result.arrived === all.length ? 1 : 0
    last += result.last / RUNS
  }
  console.log(`${name}: ${arrived} of ${wanted} arrived, all in ${complete} of ${RUNS} runs, the last one after ${last.toFixed(1)} s`)
}

process.exit(0)
