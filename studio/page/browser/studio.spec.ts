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

/** Share of the picture's pixels that are not of its most common colour, and how many colours there are. */
function picture(page: Page) {
  return ask(page, ({ viewport }) => {
    const { pixels } = viewport!.snapshot()
    const counts = new Map<number, number>()
    for (let at = 0; at < pixels.length; at += 4) {
      const colour = (pixels[at]! << 16) | (pixels[at + 1]! << 8) | pixels[at + 2]!
      counts.set(colour, (counts.get(colour) ?? 0) + 1)
    }
    return { busy: 1 - Math.max(...counts.values()) / (pixels.length / 4), colours: counts.size }
  })
}

test('the map is drawn, and can be looked into', async ({ page }) => {
  const errors: string[] = []
  page.on('pageerror', (error) => errors.push(error.message))
  page.on('request', (request) => {
    const { host } = new URL(request.url())
    if (![scene.studio, scene.planner].some((address) => new URL(address).host === host)) errors.push(request.url())
  })
  await openOnMap(page, scene)
  const whole = await picture(page)
  expect(whole.busy).toBeGreaterThan(0.25)
  expect(whole.colours).toBeGreaterThan(200)
  await page.keyboard.press('t')
  await page.keyboard.press('h')
  await expect.poll(async () => (await picture(page)).busy).toBeGreaterThan(0.4)
  // Cut at its foot, it is one level face. The graph is shown in any case.
  await ask(page, ({ state }) => {
    state.graphs.setFilter({ presence: 'off' })
    state.view.section.value = true
    state.view.sectionHeight.value = 1
  })
  await expect.poll(async () => (await picture(page)).colours).toBeLessThan(whole.colours / 4)
  expect(errors).toEqual([])
})

test('a link to another planner contacts no one unless the user agrees and the server allows it', async ({ page }) => {
  const evil = 'https://evil.example'
  const called: string[] = []
  page.on('request', (request) => called.push(new URL(request.url()).origin))
  const planner = () => ask(page, ({ state }) => new URL(state.context.planner.address).origin)
  await page.goto(`${scene.studio}?planner=${evil}`)
  const dialog = page.getByRole('dialog')
  await expect(dialog).toContainText(evil)
  await dialog.getByRole('button', { name: 'Do not connect' }).click()
  await page.waitForFunction(() => 'surefootStudio' in window)
  expect(await planner()).toBe(new URL(scene.planner).origin)
  expect(called).not.toContain(evil)

  await page.reload()
  await dialog.getByRole('button', { name: 'Connect', exact: true }).click()
  await expect(page.getByText(`--studio-connect ${evil}`).first()).toBeVisible()
  expect(await planner()).toBe(evil)
})

test('a designer forbids a leg, and the plan and the NPC go another way', async ({ page }) => {
  await openOnMap(page, scene)
  await withGraph(page)
  await page.keyboard.press('t')
  await page.keyboard.press('h')
  await page.getByRole('button', { name: 'Plan a path' }).click()
  await clickMap(page, 0.42, 0.3)
  await clickMap(page, 0.62, 0.72)
  const legs = page.getByRole('list', { name: 'Legs', exact: true }).getByRole('listitem')
  await expect(legs.nth(4)).toBeVisible()
  await expect(page.getByText('expected')).toBeVisible()

  // An NPC sets out on that way.
  await page.getByRole('button', { name: 'Send an NPC' }).click()
  const planned = () =>
    ask(
      page,
      ({ state }) =>
        state.npcs.followed.value?.plan?.waypoints.map(({ x, z }) => `${x.toFixed(1)} ${z.toFixed(1)}`) ?? [],
    )
  let before: string[] = []
  await expect.poll(async () => (before = await planned()).length).toBeGreaterThan(4)
  const pairs = (way: string[]) => way.slice(1).map((place, at) => `${way[at]} > ${place}`)

  const edges = () => ask(page, ({ state }) => state.graphs.loaded.value!.edges.length)
  const whole = await edges()
  // Its last leg between two vertices is forbidden: the NPC is far from there yet.
  const forbidden = await page.evaluate((before) => {
    const { state } = window.surefootStudio
    const graph = state.graphs.loaded.value!
    const name = (vertex: number) => `${graph.vertices[vertex]!.x.toFixed(1)} ${graph.vertices[vertex]!.z.toFixed(1)}`
    const pairs = graph.edges.map(({ from, to }) => ({ from, to, pair: `${name(from)} > ${name(to)}` }))
    const last = before.flatMap((pair) => pairs.filter((edge) => edge.pair === pair))[0]
    if (last === undefined) throw new Error(`no edge of the graph is on the NPC's way: ${before.join(', ')}`)
    state.graphs.select({ kind: 'edge', from: last.from, to: last.to })
    state.openTab('graph')
    return last.pair
  }, pairs(before).reverse())
  await page.getByRole('button', { name: 'Forbid', exact: true }).click()
  // While the new plan is made there may be none.
  const goesAnotherWay = (way: string[]) => way.length > 1 && !pairs(way).includes(forbidden)
  await expect.poll(async () => goesAnotherWay(await planned())).toBe(true)
  const shown = () =>
    ask(
      page,
      ({ state }) => state.plans.chosen.value?.waypoints.map(({ x, z }) => `${x.toFixed(1)} ${z.toFixed(1)}`) ?? [],
    )
  await expect.poll(async () => goesAnotherWay(await shown())).toBe(true)
  await expect.poll(edges).toBe(whole - 1)
  await page.getByRole('tab', { name: 'Plan', exact: true }).click()
  await legs.nth(2).getByRole('button').first().click()
  await expect(page.getByRole('button', { name: 'Forbid this leg' })).toBeVisible()
  await page.getByRole('tab', { name: 'Layers' }).click()
  await expect(page.getByText(/^Forbid /).first()).toBeVisible()

  // And back.
  await page.keyboard.press('Control+z')
  await expect.poll(edges).toBe(whole)
})

test('vertices are put in and taken out by a click, and an NPC is put elsewhere', async ({ page }) => {
  await openOnMap(page, scene)
  await withGraph(page)
  await page.keyboard.press('t')
  await page.keyboard.press('h')
  const graph = () =>
    ask(page, ({ state }) => ({
      all: state.graphs.loaded.value!.vertices.length,
      removed: state.graphs.loaded.value!.removed.length,
    }))
  const before = await graph()
  await page.getByRole('button', { name: 'Add a vertex' }).click()
  // In the middle of a graph whose edges are everywhere.
  await clickMap(page, 0.45, 0.48)
  await expect.poll(graph).toEqual({ ...before, all: before.all + 1 })
  await page.getByRole('button', { name: 'Remove a vertex' }).click()
  await clickMap(page, 0.45, 0.48)
  await expect.poll(graph).toEqual({ all: before.all + 1, removed: before.removed + 1 })
  await page.keyboard.press('Control+z')
  await page.keyboard.press('Control+z')
  await expect.poll(graph).toEqual(before)

  await page.getByRole('button', { name: 'Spawn an NPC' }).click()
  await clickMap(page, 0.45, 0.48)
  const place = () => ask(page, ({ state }) => state.npcs.followed.value?.npc?.position?.x ?? 0)
  await expect.poll(place).toBeGreaterThan(0)
  const old = await place()
  await page.getByRole('tab', { name: 'NPCs' }).click()
  await page.getByRole('button', { name: 'Teleport' }).click()
  await clickMap(page, 0.6, 0.5)
  await expect.poll(async () => Math.abs((await place()) - old)).toBeGreaterThan(15)
  await page.getByRole('button', { name: 'Remove', exact: true }).click()
  await page.getByRole('button', { name: 'Yes' }).click()
  await expect.poll(() => ask(page, ({ state }) => state.npcs.selectedId.value === undefined)).toBe(true)
})

test('a block is put onto the map and taken away again, and the picture and the graph follow', async ({ page }) => {
  await openOnMap(page, scene)
  await withGraph(page)
  const graph = () => ask(page, ({ state }) => state.graphs.summary.value?.mapHash)
  const before = await graph()
  await page.keyboard.press('t')
  await page.keyboard.press('h')
  const section = page.getByRole('region', { name: 'Pieces on the map' })
  await section.getByLabel('Width, m').fill('20')
  await section.getByLabel('Height, m').fill('6')
  await ask(page, ({ state }) => state.graphs.setFilter({ presence: 'off' }))
  const pixels = () => ask(page, ({ viewport }) => [...viewport!.snapshot().pixels].reduce((sum, it) => sum + it, 0))
  const bare = await pixels()
  await section.getByRole('button', { name: 'Add to the map' }).click()
  await clickMap(page, 0.45, 0.48)
  await expect(section.getByText('block 1')).toBeVisible()
  await expect.poll(graph, { timeout: 30_000 }).not.toBe(before)
  await expect.poll(pixels).not.toBe(bare)
  await page.screenshot({ path: 'test-results/block.png' })
  await section.getByRole('button', { name: 'Remove block 1' }).click()
  await expect(section.getByText('block 1')).toBeHidden()
  await expect.poll(graph, { timeout: 30_000 }).toBe(before)
})

test('a graph is built while its progress is shown, and compared', async ({ page }) => {
  await openOnMap(page, scene)
  await withGraph(page)
  await page.getByRole('tab', { name: 'Build' }).click()
  await page.getByLabel('Vertices').fill('150')
  await page.getByLabel('Run all probes of every candidate').check()
  await page.getByRole('button', { name: 'Start the build' }).click()
  await expect(page.getByRole('progressbar')).toBeVisible()
  await expect(page.getByText(/of [\d,\u202f ]+ probes/)).toBeVisible()
  await expect(page.getByText(/^Built in/)).toBeVisible({ timeout: 90_000 })
  await page.getByRole('button', { name: 'Show this graph' }).click()
  await expect.poll(() => ask(page, ({ state }) => state.graphs.loaded.value?.vertices.length)).toBeGreaterThan(149)

  // What it reaches and the one before did not, or the other way round.
  await page.getByRole('button', { name: 'Compare', exact: true }).click()
  await expect(page.getByText('Places lost')).toBeVisible()
  expect(await page.getByLabel('Before').inputValue()).not.toBe(await page.getByLabel('After').inputValue())

  // Another one is begun and cancelled.
  await page.getByLabel('Vertices').fill('700')
  await page.getByRole('button', { name: 'Start the build' }).click()
  await expect(page.getByRole('progressbar')).toBeVisible()
  await page.getByRole('button', { name: 'Cancel the build' }).click()
  await expect(page.getByText('Cancelled.')).toBeVisible()
})

test('an edge is probed again, and its attempt is played', async ({ page }) => {
  await openOnMap(page, scene)
  await withGraph(page)
  await ask(page, ({ state }) => {
    // One that does not go away while NPCs report how they fared.
    const [best] = [...state.graphs.loaded.value!.edges].sort((a, b) => b.successes - a.successes)
    state.graphs.select({ kind: 'edge', from: best!.from, to: best!.to })
    state.openTab('graph')
    // A replay may begin and end between two questions.
    const played: boolean[] = []
    state.probes.playing.subscribe((playing) => void played.push(playing))
    Object.assign(window, { played })
  })
  const played = () => page.evaluate<boolean[]>('window.played')
  const probe = page.getByRole('group', { name: 'Probe the edge' })
  await expect(probe).toContainText('Not probed here yet.')
  const replays = [false]
  for (const made of [1, 2]) {
    await probe.getByRole('button', { name: 'Probe again' }).click()
    await expect.poll(() => ask(page, ({ state }) => state.probes.made.value.length), { timeout: 20_000 }).toBe(made)
    replays.push(true, false)
    await expect.poll(played, { timeout: 30_000 }).toEqual(replays)
  }
  await expect(probe).toContainText(/(Arrived after|Did not arrive within) .+\. [0-2] of 2 probes made here arrived\./)
  // The planner takes them as evidence.
  await probe.getByRole('button', { name: 'Count 2' }).click()
  await expect(probe.getByRole('button', { name: /^Count/ })).toBeHidden()
})

test('what another designer did meanwhile is shown, and nothing is lost', async ({ page, context }) => {
  await openOnMap(page, scene)
  await withGraph(page)
  const late = await context.newPage()
  // This page gets no changes.
  await late.route('**/WatchGraph', () => undefined)
  await openOnMap(late, scene)
  await withGraph(late)
  const forbid = (who: Page, index: number) =>
    who.evaluate((index) => {
      const { state } = window.surefootStudio
      const { from, to } = state.graphs.loaded.value!.edges[index]!
      state.graphs.select({ kind: 'edge', from, to })
      state.openTab('graph')
    }, index)
  await forbid(page, 10)
  await page.getByRole('button', { name: 'Forbid', exact: true }).click()
  await expect.poll(() => ask(page, ({ state }) => state.layers.list.value[0]?.edits.length ?? 0)).toBe(1)
  await forbid(late, 20)
  await late.getByRole('button', { name: 'Forbid', exact: true }).click()
  const card = late.getByRole('alert', { name: 'Not applied' })
  await expect(card).toContainText('Another user changed the layers')
  await card.getByRole('button', { name: 'Apply on top' }).click()
  await expect(card).toBeHidden()
  // The other page gets them.
  await expect.poll(() => ask(page, ({ state }) => state.layers.list.value[0]?.edits.length ?? 0)).toBe(2)
})

test('when the server is gone the page says so and comes back by itself', async ({ page }) => {
  await openOnMap(page, scene)
  await withGraph(page)
  const tick = () => ask(page, ({ state }) => Number(state.live.moment.value.tick))
  // Old enough that the one after it is younger for long.
  await expect.poll(tick, { timeout: 60_000 }).toBeGreaterThan(1500)
  await scene.kill()
  await expect(page.getByText('The world server does not answer')).toBeVisible()
  const before = await tick()
  await ask(page, ({ state }) => {
    Object.assign(window, { summaryBefore: state.graphs.summary.value })
  })
  await scene.restart()
  // The state of the old world does not count.
  const npcs = () => ask(page, ({ state }) => state.live.moment.value.npcs.size)
  await expect.poll(async () => (await npcs()) === 8 && (await tick()) < before, { timeout: 30_000 }).toBe(true)
  await expect(page.getByText('The world server does not answer')).toBeHidden()
  // The planner sends the graph again: neither earlier changes nor those that came with the graph count.
  await expect
    .poll(
      () =>
        ask(page, ({ state }) => {
          const { summary, loaded } = state.graphs
          const old: unknown[] = [undefined, Reflect.get(window, 'summaryBefore'), loaded.value?.summary]
          return !old.includes(summary.value)
        }),
      { timeout: 60_000 },
    )
    .toBe(true)
  await withGraph(page)
})

test('a designer drops a level, reads what is odd about it, and gets a world of it with another body', async ({
  page,
}) => {
  await openOnMap(page, scene)
  // A floor of 40 x 30 m in centimetres, z up, one-sided: one quad.
  const corners = ['0 0 0', '4000 0 0', '4000 3000 0', '0 3000 0'].map((at) => `v ${at}\n`).join('')
  const buffer = Buffer.from(`o floor\n${corners}f 1 2 3 4\n`)
  const section = page.getByRole('region', { name: 'Import a level' })
  await section.locator('input[type=file]').setInputFiles({ name: 'court.obj', mimeType: 'model/obj', buffer })
  await section.getByLabel('Metres per unit').fill('0.01')
  await section.getByLabel('Up').selectOption({ label: 'z' })
  await section.getByRole('button', { name: 'Import' }).click()
  await expect(section.getByText('court.obj: 44 x 34 m, 21 m high')).toBeVisible()
  await section.getByRole('button', { name: 'Show the report' }).click()
  const report = page.getByRole('region', { name: 'Report' })
  await expect(report.getByRole('status')).toHaveText('court.obj: 1 node: 1 solid')
  await report.getByText('Geometry').click()
  await expect(report.getByText('Open edges')).toBeVisible()
  await page.getByRole('tab', { name: 'Map' }).click()
  await section.getByLabel('Body').selectOption({ label: 'Unity' })
  await section.getByRole('button', { name: 'Create world' }).click()
  await expect.poll(() => ask(page, ({ state }) => state.worlds.chosen.value?.bodies[0]?.preset)).toBe('unity')
  await expect.poll(() => ask(page, ({ state }) => state.level.features.value?.size.width)).toBe(44)
  // What bodies find there, before there is a graph.
  await section.getByRole('button', { name: 'Compare bodies' }).click()
  const table = section.getByRole('table', { name: 'Reachability by body' })
  await expect(table.getByRole('row')).toHaveCount(8, { timeout: 30_000 })
  await page.screenshot({ path: 'test-results/imported-level.png' })
  // Lava is marked on the floor, drawn, and part of the next import.
  await ask(page, ({ state }) => {
    state.setTool('mark')
    state.marks.choose('lava')
    state.marks.click({ x: 10, y: 1, z: 10 })
    state.marks.click({ x: 16, y: 1, z: 14 })
  })
  const marks = page.getByRole('region', { name: 'Mark features' })
  await expect(marks.getByText('Lava at')).toBeVisible()
  const download = page.waitForEvent('download')
  await marks.getByRole('button', { name: 'Save the sidecar' }).click()
  expect((await download).suggestedFilename()).toBe('court.surefoot.json')
  await page.screenshot({ path: 'test-results/marks.png' })
  await marks.getByRole('button', { name: 'Import with marks' }).click()
  await expect
    .poll(() => ask(page, ({ state }) => state.level.features.value?.pools.map(({ centre }) => centre)), {
      timeout: 30_000,
    })
    .toMatchObject([{ x: expect.closeTo(13, 1), z: expect.closeTo(12, 1) }])
  await expect
    .poll(() => ask(page, ({ state }) => state.graphs.loaded.value?.edges.length ?? 0), { timeout: 90_000 })
    .toBeGreaterThan(10)
})
