import { expect, test } from '@playwright/test'
import { ask, open, openAtFirst, violations, withGraph } from './page'
import { Scene } from './scene'

let scene: Scene
test.beforeAll(async () => {
  scene = await Scene.start()
})
test.afterAll(async () => {
  await scene.stop()
})

const TABS = ['Map', 'NPCs', 'Graph', 'Plan', 'Layers', 'Build']

for (const colorScheme of ['light', 'dark'] as const) {
  test(`axe finds nothing wrong with any panel in ${colorScheme} mode`, async ({ page }) => {
    await page.emulateMedia({ colorScheme })
    await openAtFirst(page, scene)
    await withGraph(page)
    expect(await page.evaluate(() => document.documentElement.dataset.theme)).toBe(colorScheme)
    const found: string[] = []
    const check = async (what: string) => {
      found.push(...(await violations(page)).map((violation) => `${what}: ${violation}`))
    }
    await expect(page.getByRole('button', { name: 'Take the tour' })).toBeVisible()
    await check('offer of the tour')
    await page.getByRole('button', { name: 'Take the tour' }).click()
    await check('tour')
    await page.getByRole('button', { name: 'End the tour' }).click()
    // A plan, an edge, a layer with an edit, and a replay.
    await ask(page, ({ state }) => {
      const { vertices, edges } = state.graphs.loaded.value!
      state.plans.setEnds(vertices[0], vertices[vertices.length - 1])
      state.graphs.select({ kind: 'edge', from: edges[5]!.from, to: edges[5]!.to })
    })
    for (const name of TABS) {
      await page.getByRole('tab', { name }).click()
      await page.waitForTimeout(300)
      await check(name)
    }
    await page.keyboard.press('?')
    await expect(page.getByRole('dialog')).toBeVisible()
    await check('help')
    await page.keyboard.press('Escape')
    await ask(page, ({ state }) => state.toggleReplay())
    await ask(page, ({ state }) => {
      state.view.section.value = true
      state.view.plots.value = true
      state.context.toasts.say('An example of a message.', 'bad')
    })
    await check('replay, section and a message')
    await ask(page, ({ state }) => {
      state.setTool('player')
      const { x, y, z } = state.graphs.loaded.value!.vertices[0]!
      return state.player.click(state.worlds.chosenId.value!, { x, y, z }).then(() => state.chasePlayer())
    })
    await expect(page.getByRole('group', { name: 'Player' })).toContainText('chases')
    await check('player')
    await ask(page, ({ state }) => {
      state.setTool('reach')
      state.reach.setStart(state.graphs.loaded.value!.vertices[0]!)
    })
    await expect(page.getByRole('group', { name: 'Reachable area' })).toContainText('of the vertices')
    await check('reachable area')
    expect(found).toEqual([])
  })
}

test('the switch of the theme is remembered', async ({ page }) => {
  await page.emulateMedia({ colorScheme: 'light' })
  await open(page, scene)
  const theme = () => page.evaluate(() => document.documentElement.dataset.theme)
  expect(await theme()).toBe('light')
  await page.getByRole('button', { name: /^Theme/ }).click()
  expect(await theme()).toBe('dark')
  await page.reload()
  await page.waitForFunction(() => 'surefootStudio' in window)
  expect(await theme()).toBe('dark')
})

test('Tab goes through the page in reading order, and each stop has a name and can be seen', async ({ page }) => {
  await open(page, scene)
  await expect.poll(() => ask(page, ({ state }) => state.npcs.followed.value?.npc !== undefined)).toBe(true)
  const stops: { area: string; name: string; outlined: boolean }[] = []
  for (let step = 0; step < 60; step += 1) {
    await page.keyboard.press('Tab')
    const stop = await page.evaluate(() => {
      const at = document.activeElement
      if (at === null || at === document.body) return undefined
      const area = at.closest('.top-bar, .rail, .middle, .panel, .dashboard')?.classList[0] ?? 'elsewhere'
      const label = at instanceof HTMLInputElement || at instanceof HTMLSelectElement ? at.labels?.[0]?.textContent : ''
      const name =
        at.getAttribute('aria-label') ?? (label || at.getAttribute('aria-labelledby') || at.textContent) ?? ''
      return { area, name: name.trim(), outlined: getComputedStyle(at).outlineStyle !== 'none' }
    })
    if (stop === undefined) break
    stops.push(stop)
  }
  expect(stops.filter(({ name, outlined }) => name === '' || !outlined)).toEqual([])
  const areas = stops.map(({ area }) => area).filter((area, index, all) => area !== all[index - 1])
  expect(areas.slice(0, 4)).toEqual(['top-bar', 'rail', 'middle', 'panel'])
})
