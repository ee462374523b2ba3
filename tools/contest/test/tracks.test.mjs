import assert from 'node:assert/strict'
import { before, test } from 'node:test'
import { Crowd, init } from '@recast-navigation/core'
import { Baked, agentOf, priceAreas } from '../navmesh.mjs'
import { PathFinder } from '../paths.mjs'
import { alongPath, crowdAgent, inCrowd, turned } from '../tracks.mjs'
import { BODY, boxes } from './levels.mjs'

const GROUND = [
  [0, -1, 0],
  [30, 0, 30],
]
const WALL = [
  [14, 0, 4],
  [16, 3, 30],
]

before(() => init())

/** Length of a track, m, and the heading and the speed at each of its bodies. */
function seen(track) {
  const length = track.slice(1).reduce((sum, [x, y, z], at) => sum + Math.hypot(x - track[at][0], y - track[at][1], z - track[at][2]), 0)
  return { length, yaws: track.map((it) => it[3]), speeds: track.map(([, , , , x, , z]) => Math.hypot(x, z)) }
}

test('a heading turns to the direction of motion the short way, and no faster than the body', () => {
  assert.ok(Math.abs(turned(0, [1, 0, 0], Math.PI) - Math.PI / 60) < 1e-9)
  assert.ok(Math.abs(turned(0, [1, 0, 0], 1e3) - Math.PI / 2) < 1e-9)
  assert.ok(turned(3, [Math.sin(-3), 0, Math.cos(-3)], Math.PI) > 3, 'over the back')
  assert.equal(turned(2, [0.01, 5, 0], Math.PI), 2, 'a body that only falls keeps its heading')
})

test('a track along a path keeps its speed, passes the corners, and ends at the goal', () => {
  const goal = { start: [0, 0, 0], yaw: 0, goal: [10.5, 0, 10] }
  const points = [goal.start, [0, 0, 10], goal.goal]
  const track = alongPath(goal, points, { speed: 6, turnSpeed: Math.PI })
  const { length, yaws, speeds } = seen(track)
  // A metre in each decision; it has arrived within a metre of the goal.
  assert.equal(track.length, 21)
  assert.ok(Math.abs(length - 20) < 0.01, `${length} m`)
  assert.ok(speeds.slice(1).every((speed) => Math.abs(speed - 6) < 1e-3))
  assert.deepEqual(track[10].slice(0, 3), [0, 0, 10])
  assert.ok(yaws.slice(0, 11).every((yaw) => yaw === 0) && Math.abs(yaws.at(-1) - Math.PI / 2) < 1e-3)
})

test('a track ends on its goal, however far a decision leads', () => {
  const goal = { start: [0, 0, 0], yaw: 0, goal: [0, 0, 5] }
  const track = alongPath(goal, [goal.goal], { speed: 20, turnSpeed: Math.PI })
  assert.deepEqual(
    track.map(([, , z]) => z),
    [0, 3.3333, 5],
  )
})

test('an agent goes round a wall as fast as it may, and arrives like the path', () => {
  const navMesh = new Baked(boxes(GROUND, WALL), agentOf(BODY), []).navMesh([])
  const finder = new PathFinder(navMesh, [])
  const crowd = new Crowd(navMesh, { maxAgents: 1, maxAgentRadius: 0.3 })
  priceAreas(crowd.getFilter(0))
  const goal = { start: [8, 0, 20], yaw: 0, goal: [22, 0, 20] }
  const [from, to] = [goal.start, goal.goal].map((place) => finder.nearest(place).at)
  const agent = crowdAgent({ radius: 0.3, height: 1.8, speed: 3.5 })
  const track = () => inCrowd(crowd, goal, { from, to }, { agent, turnSpeed: Math.PI })
  const first = track()
  const { length, speeds } = seen(first)
  const [x, , z] = first.at(-1)
  assert.ok(Math.hypot(x - 22, z - 20) <= 1)
  assert.ok(Math.max(...speeds) <= 3.51 && Math.max(...speeds) > 3)
  const { path } = finder.approach(goal).approach
  const shortest = seen(alongPath(goal, path.map(({ at }) => at), { speed: 11, turnSpeed: Math.PI })).length
  assert.ok(length > 0.95 * shortest && length < 1.1 * shortest, `${length} m, ${shortest} m`)
  assert.deepEqual(track(), first, 'agents leave nothing behind')
})
