// Lets NPCs of a server go to goals, with the installed npm package: node walk.mjs SERVER POLICY
import { readFile } from 'node:fs/promises'
import { createRequire } from 'node:module'

// The ONNX runtime for web pages expects it in Node.js.
globalThis.require = createRequire(import.meta.url)
const { connect, Policy, worldV1 } = await import('surefoot')

const [server, policy] = process.argv.slice(2)
const { memoryLen } = await Policy.load(await readFile(policy))
const surefoot = connect({ world: server })
const { world } = await surefoot.worlds.createWorld({ map: { seed: 7n, size: { width: 60, height: 40, depth: 60 } } })
const { points } = await surefoot.worlds.sampleGround({ worldId: world.worldId, count: 32 })
const spawns = points.slice(16).map((position, idx) => ({ position, goal: points[idx] }))
await surefoot.spawn(world.worldId, spawns)
for await (const { npcs } of surefoot.watchWorld(world.worldId)) {
  const arrived = npcs.filter((npc) => npc.lastOutcome === worldV1.Outcome.REACHED)
  if (arrived.length > 0) {
    console.log(`an NPC arrived; the policy has ${memoryLen} values of memory`)
    process.exit(0)
  }
}
