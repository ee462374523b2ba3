// The client against a world server: a level, NPCs, and streams that outlive a restart.

import { afterAll, beforeAll, expect, test } from 'vitest'
import { Code, ConnectError } from '@connectrpc/connect'
import { levelObj, START } from '../examples/three/level.ts'
import { connect, keepWatching, type Surefoot } from '../src/client/index.ts'
import { add } from '../src/vec3.ts'
import { Folder, serve, type Service } from './program.ts'

const folder = new Folder()
const STATE = ['--state', folder.file('state'), '--save-every', '1']
let service: Service
let surefoot: Surefoot

beforeAll(async () => {
  service = await serve('serve', STATE)
  surefoot = connect({ world: service.url })
})

afterAll(async () => {
  await service?.kill()
  folder.close()
})

test('a level is imported, NPCs are spawned and seen, also after the server has restarted', async () => {
  const { mapHash, origin, warnings } = await surefoot.importLevel('level.obj', new TextEncoder().encode(levelObj()))
  expect([mapHash.length, warnings]).toEqual([64, []])
  const worldId = await surefoot.createWorld(mapHash)
  const spawned = await surefoot.spawn(worldId, [
    { position: add(START, origin) },
    { position: add(START, origin), yaw: 1 },
  ])
  expect(spawned).toHaveLength(2)
  const broken: unknown[] = []
  let snapshots = 0
  const onBreak = (error: unknown) => broken.push(error)
  for await (const { npcs } of surefoot.watchWorld(worldId, { rateHz: 20, movement: true, onBreak })) {
    expect(npcs.map(({ npcId }) => npcId)).toEqual(spawned)
    expect(npcs.every(({ movement }) => movement !== undefined)).toBe(true)
    snapshots += 1
    if (broken.length > 0) break
    if (snapshots === 60) await restart()
  }
  expect(snapshots).toBeGreaterThan(60)
})

/** Ends the server at once and starts it again at the same address, with what it has saved. */
async function restart(): Promise<void> {
  const { host } = new URL(service.url)
  await service.kill()
  service = await serve('serve', STATE, host)
}

test('events come once each', async () => {
  const { points, worldId } = await newWorld()
  const seen: [bigint, string | undefined][] = []
  const events = surefoot.watchEvents(worldId)
  const first = events.next()
  // The stream has to have begun before something happens.
  await new Promise((resolve) => setTimeout(resolve, 500))
  const [npcId] = await surefoot.spawn(worldId, [{ position: points[0]! }])
  for (let event = await first; !event.done; event = await events.next()) {
    seen.push([event.value.npcId, event.value.event.case])
    if (event.value.event.case === 'removed') break
    if (seen.length === 1) await surefoot.worlds.despawnNpc({ npcId: npcId! })
  }
  expect(seen[0]).toEqual([npcId, 'spawned'])
  expect(seen.at(-1)).toEqual([npcId, 'removed'])
})

async function newWorld() {
  const { world } = await surefoot.worlds.createWorld({ map: { seed: 7n, size: { width: 60, height: 40, depth: 60 } } })
  const { worldId } = world!
  const { points } = await surefoot.worlds.sampleGround({ worldId, count: 1 })
  return { worldId, points }
}

test('an error that retrying cannot fix is thrown', async () => {
  await expect(surefoot.watchWorld(123n).next()).rejects.toMatchObject({ code: Code.NotFound })
  const { worldId } = await newWorld()
  await expect(surefoot.spawn(worldId, [{ position: { x: -900, y: 0, z: 0 } }])).rejects.toThrow(
    'npcs[0] was not added',
  )
  await expect(surefoot.spawn(worldId, [{ position: { x: NaN, y: 0, z: 0 } }])).rejects.toThrow('npcs[0].position')
})

test('a stream is opened again with pauses until its reader leaves', async () => {
  let opened = 0
  const open = async function* () {
    opened += 1
    yield opened
    throw new ConnectError('gone', Code.Unavailable)
  }
  const read = []
  for await (const message of keepWatching(open)) {
    read.push(message)
    if (message === 3) break
  }
  expect(read).toEqual([1, 2, 3])
})

test('what is missing or malformed is named', async () => {
  expect(() => connect({})).toThrow('world server (world) or a planner (planner)')
  expect(() => connect({ world: 'here' })).toThrow('world is here, but must be a complete address')
  expect(() => surefoot.planner).toThrow('no planner is connected')
  await expect(surefoot.importLevel('level.fbx', new Uint8Array())).rejects.toThrow('level.fbx is no level')
})
