import { expect, type Page, test } from '@playwright/test'
import { ask, clickMap, openOnMap, withGraph } from './page'
import { Scene } from './scene'

let scene: Scene
test.beforeAll(async () => {
  scene = await Scene.start()
})
test.afterAll(async () => {
  await scene.stop()
})

test('a click shows what is reachable, with more time more of it, and Escape takes it away', async ({ page }) => {
  await openOnMap(page, scene)
  await withGraph(page)
  let calls = 0
  page.on('request', (request) => (calls += Number(request.url().endsWith('/FindReachable'))))
  const bar = page.getByRole('group', { name: 'Reachable area' })
  await page.keyboard.press('0')
  await expect(bar).toBeVisible()
  await lookAtMainIsland(page)
  const before = await picture(page)
  await clickMap(page, 0.5, 0.5)
  const text = /^[\d,]+ m², [\d.]+ % of the vertices$/
  const figures = bar.getByRole('status').locator('span')
  await expect(figures).toHaveText(text)
  await expect.poll(async () => changed(await picture(page), before)).toBeGreaterThan(0.02)

  // Another time shows another area at once. A changed graph may be asked in between.
  const slider = bar.getByRole('slider', { name: 'Within' })
  const squareMetres = async () => Number((await figures.textContent())!.split(' ')[0]!.replaceAll(',', ''))
  const asked = calls
  const usual = await squareMetres()
  for (let seconds = 10; seconds <= 30; seconds += 1) await slider.fill(String(seconds))
  await expect(bar).toContainText('30 s')
  const most = await squareMetres()
  await slider.fill('5')
  await expect.poll(squareMetres).toBeLessThan(usual)
  expect(most).toBeGreaterThan(usual)
  expect(calls - asked).toBeLessThan(4)

  // With another caution of plans, the page asks again.
  const soFar = calls
  await ask(page, ({ state }) => state.plans.setCaution('bold'))
  await expect.poll(() => calls).toBeGreaterThan(soFar)
  await expect(figures).toHaveText(text)

  // Without a graph the page says so. The area comes back with the graph.
  const said = await ask(page, ({ state }) => {
    const [id, world] = [state.graphs.id.value!, state.worlds.chosen.value!]
    state.graphs.forget()
    const text = () => document.querySelector('.reach-bar')!.textContent
    return new Promise<string>((resolve) => setTimeout(() => resolve(text()), 0)).finally(() =>
      state.graphs.show(world.mapHash, id),
    )
  })
  expect(said).toContain('There is no graph')
  await expect(figures).toHaveText(text)

  await page.keyboard.press('Escape')
  await expect(bar).toBeHidden()
  expect(await ask(page, ({ state }) => state.reach.area.value === undefined)).toBe(true)
})

/** Looks at the middle of the largest island from above. */
function lookAtMainIsland(page: Page): Promise<void> {
  return ask(page, ({ state, viewport }) => {
    const { vertices, islands } = state.graphs.loaded.value!
    const size = (island: number) => islands.filter((it) => it === island).length
    const [x, z] = [100, 100]
    const [at] = vertices
      .filter((_, index) => size(islands[index]!) > vertices.length / 2)
      .sort((a, b) => Math.hypot(a.x - x, a.z - z) - Math.hypot(b.x - x, b.z - z))
    viewport!.setCamera({ target: { ...at! }, distance: 110, azimuth: 0, polar: 0.6 })
  })
}

function picture(page: Page): Promise<number[]> {
  return ask(page, ({ viewport }) => [...viewport!.snapshot().pixels.filter((_, at) => at % 16 === 0)])
}

/** The share of pixels that differ. */
function changed(a: readonly number[], b: readonly number[]): number {
  return a.filter((value, at) => Math.abs(value - b[at]!) > 12).length / a.length
}
