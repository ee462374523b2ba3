import { expect, type Page, test } from '@playwright/test'
import { ask, clickMap, openOnMap, withGraph } from './page'
import { Scene } from './scene'
import type { StudioHook } from '../src/main'

let scene: Scene
test.beforeAll(async () => {
  scene = await Scene.start()
})
test.afterAll(async () => {
  await scene.stop()
})

const place = (page: Page) => ask(page, ({ state }) => state.player.at.value!)
const players = (page: Page) => ask(page, ({ state }) => state.live.moment.value.players.length)

test('a player walks by keys and clicks, NPCs chase it, and it goes with its tool', async ({ page }) => {
  await openOnMap(page, scene)
  await withGraph(page)
  const bar = page.getByRole('group', { name: 'Player' })
  await page.keyboard.press('9')
  await putPlayer(page)
  await expect(bar).toBeVisible()

  // The camera, which has the same keys, goes with the player.
  const start = await place(page)
  const camera = () => ask(page, ({ viewport }) => viewport!.camera().target)
  const before = await camera()
  await page.keyboard.down('w')
  await expect.poll(async () => apart(await place(page), start)).toBeGreaterThan(1)
  await page.keyboard.up('w')
  const walked = await place(page)
  const [by, after] = [apart(walked, start), await camera()]
  expect(Math.abs(apart(after, before) - by)).toBeLessThan(1)
  const served = () =>
    ask(page, ({ state }) => {
      const [player, at] = [state.live.moment.value.players[0], state.player.at.value!]
      const { x, z } = player!.position!
      return Math.hypot(x - at.x, z - at.z) + Math.hypot(player!.velocity?.x ?? 0, player!.velocity?.z ?? 0)
    })
  await expect.poll(served).toBeLessThan(0.01)

  // One that has some way to go.
  await spawnAway(page)
  const metres = () =>
    ask(page, ({ state }) => {
      const [npc, at] = [
        state.live.moment.value.npcs.get(state.npcs.selectedId.value!)?.position,
        state.player.at.value!,
      ]
      return npc === undefined ? 0 : Math.hypot(npc.x - at.x, npc.y - at.y, npc.z - at.z)
    })
  await expect.poll(metres).toBeGreaterThan(8)
  await bar.getByRole('button', { name: 'Chase the player' }).click()
  await expect(bar).toContainText(/NPC \d+ chases it/)
  await expect.poll(metres, { timeout: 60_000 }).toBeLessThan(3)
  // The crowd of `surefoot up` has not given it a goal of its own.
  const underWay = ({ state }: StudioHook) => {
    const npc = state.live.moment.value.npcs.get(state.npcs.selectedId.value!)!
    return npc.attemptsBegun - npc.attemptsEnded
  }
  expect(await ask(page, underWay)).toBe(1)
  // It keeps to the player as that walks on.
  // A click may meet the chaser, or a place that the player cannot walk to.
  const spots = [0.4, 0.3, 0.6, 0.7].flatMap((x) => [0.4, 0.6].map((y) => [x, y] as const))
  await expect(async () => {
    const [x, y] = spots.shift()!
    await clickMap(page, x, y)
    await expect.poll(async () => apart(await place(page), walked), { timeout: 3000 }).toBeGreaterThan(0.5)
  }).toPass({ timeout: 40_000 })
  await expect.poll(metres, { timeout: 60_000 }).toBeLessThan(3)

  await bar.getByRole('button', { name: 'Stop chasing' }).click()
  await expect(bar).toContainText('No NPC chases it')
  await page.keyboard.press('Escape')
  await expect(bar).toBeHidden()
  await expect.poll(() => players(page)).toBe(0)
})

test('a player that the user leaves behind with the page is removed', async ({ page, context }) => {
  await openOnMap(page, scene)
  await withGraph(page)
  await page.keyboard.press('9')
  await putPlayer(page)
  const other = await context.newPage()
  await openOnMap(other, scene)
  await expect.poll(() => players(other)).toBe(1)
  // A browser that closes a tab of a busy page may end it before it says anything.
  await page.goto('about:blank')
  await expect.poll(() => players(other)).toBe(0)
})

/** Puts the player on open ground. An NPC that stands where the first click goes takes that click. */
async function putPlayer(page: Page): Promise<void> {
  await lookAtOpenGround(page)
  const spots = [0.5, 0.45, 0.55, 0.4, 0.6]
  await expect(async () => {
    await clickMap(page, spots.shift()!, 0.5)
    await expect.poll(() => players(page), { timeout: 6000 }).toBe(1)
  }).toPass({ timeout: 40_000 })
}

/** Looks at a vertex of the largest island with 7 m of level ground ahead. */
function lookAtOpenGround(page: Page): Promise<void> {
  return ask(page, ({ state, viewport }) => {
    const { vertices, islands } = state.graphs.loaded.value!
    const size = (island: number) => islands.filter((it) => it === island).length
    const isOpen = ({ x, y, z }: { x: number; y: number; z: number }) =>
      [0, 1, 2, 3, 4, 5, 6, 7].every((metres) => {
        const down = viewport!.distanceToGround({ x, y: y + 2, z: z - metres }, { x: 0, y: -1, z: 0 })
        return down !== undefined && Math.abs(down - 2) < 0.3
      })
    const at = vertices.find((vertex, index) => size(islands[index]!) > vertices.length / 2 && isOpen(vertex))
    viewport!.setCamera({ target: { ...at! }, distance: 30, azimuth: 0, polar: 0.3 })
  })
}

/** Spawns an NPC on the largest island, some way from the player, and selects it. */
function spawnAway(page: Page): Promise<unknown> {
  return ask(page, ({ state }) => {
    const { vertices, islands } = state.graphs.loaded.value!
    const size = (island: number) => islands.filter((it) => it === island).length
    const at = state.player.at.value!
    const metres = (vertex: { x: number; z: number }) => Math.hypot(vertex.x - at.x, vertex.z - at.z)
    const [there] = vertices
      .filter((vertex, index) => size(islands[index]!) > vertices.length / 2 && metres(vertex) > 12)
      .sort((a, b) => metres(a) - metres(b))
    return state.npcs.spawn(state.worlds.chosenId.value!, { x: there!.x, y: there!.y, z: there!.z }).then(String)
  })
}

function apart(a: { x: number; z: number }, b: { x: number; z: number }): number {
  return Math.hypot(a.x - b.x, a.z - b.z)
}
