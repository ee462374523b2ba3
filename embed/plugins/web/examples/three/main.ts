// An NPC that runs to where one clicks: the policy on three.js' rays, along plans over the level's graph. No server takes part.

import { Agents, Graph, Locomotion, originOf, Policy, Walkers } from '../../dist/index.js'
import { Character, TICK_SECONDS } from './character.ts'
import { BOXES, lowestCorner, START } from './level.ts'
import { Scene } from './scene.ts'

const TICKS_PER_DECISION = 10
/** Simulated time that a slow page makes up for in a frame, s. */
const MOST_SECONDS = 0.25
/** The only agent. */
const NPC = 0

const [policy, graph] = await Promise.all([
  Policy.load('policy.onnx'),
  Graph.load('graph.json', originOf(lowestCorner())),
])
const agents = new Agents(policy)
const walkers = new Walkers(agents, graph)
const scene = new Scene(BOXES, agents.body)
let character = new Character(agents.body, BOXES, START)
let locomotion = new Locomotion(agents.body)
let action = { forward: 0, strafe: 0, turn: 0, jump: 0 }
let tick = 0

scene.onClick((goal) => walkers.send(NPC, goal))

/** Moves the character for 1/60 s, and lets its agent decide in every tenth of them. */
async function step(): Promise<void> {
  if (tick % TICKS_PER_DECISION === 0) {
    ;[action = action] = await walkers.decide([NPC], [character.state], scene.castRays)
    character.begin(action)
    const follower = walkers.follower(NPC)
    scene.showPlan(character.feet, follower?.plan, follower?.waypointIdx ?? 0)
  }
  character.tick(action)
  locomotion.advance(character.state, action)
  walkers.note(NPC, character.state)
  tick += 1
  if (character.feet.y < lowestCorner().y - 5) respawn()
}

/** Puts the character back to the start after a fall. */
function respawn(): void {
  character = new Character(agents.body, BOXES, START)
  locomotion = new Locomotion(agents.body)
  walkers.stop(NPC)
  agents.begin(NPC)
}

let [last, owed] = [performance.now(), 0]
async function frame(now: number): Promise<void> {
  owed = Math.min(owed + (now - last) / 1000, MOST_SECONDS)
  last = now
  for (; owed >= TICK_SECONDS; owed -= TICK_SECONDS) await step()
  scene.draw(character.state, locomotion)
  const { x, y, z } = character.feet
  const status = document.querySelector('output')!
  status.value = `${walkers.status(NPC)} at ${[x, y, z].map((value) => value.toFixed(1)).join(' ')}`
  requestAnimationFrame(frame)
}
requestAnimationFrame(frame)
