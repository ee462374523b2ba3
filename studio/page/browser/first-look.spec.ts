import { readFile } from 'node:fs/promises'
import { expect, type Page, test } from '@playwright/test'
import { ask, clickMap, open, openAtFirst, openOnMap, withGraph } from './page'
import { Scene } from './scene'

let scene: Scene
test.beforeAll(async () => {
  scene = await Scene.start()
})
test.afterAll(async () => {
  await scene.stop()
})

const selected = (page: Page) => ask(page, ({ state }) => String(state.npcs.selectedId.value))

test('a fresh page opens near an NPC under way, with its plan, faint edges and names', async ({ page }) => {
  await open(page, scene)
  await withGraph(page)
  await expect.poll(() => ask(page, ({ state }) => state.npcs.camera.value)).toBe(true)
  const bar = page.getByRole('group', { name: 'Watch NPCs' })
  await expect(bar).toContainText(/NPC \d+/)
  await bar.getByRole('button', { name: 'Another' }).click()
  await expect(bar).toContainText(/leg \d+ of \d+/)
  expect(await ask(page, ({ viewport }) => viewport!.camera().distance)).toBeLessThan(25)
  const apart = () =>
    ask(page, ({ state, viewport }) => {
      const { target } = viewport!.camera()
      const at = state.live.moment.value.npcs.get(state.npcs.selectedId.value!)!.position!
      return Math.hypot(target.x - at.x, target.z - at.z)
    })
  await expect.poll(apart).toBeLessThan(4)
  const presence = () => ask(page, ({ state }) => state.graphs.filter.value.presence)
  expect(await presence()).toBe('faint')
  await page.keyboard.press('g')
  expect(await presence()).toBe('full')

  // Names are a layer of their own, and stay off on the next visit.
  const named = () =>
    page.evaluate(() => {
      const canvas = document.querySelector<HTMLCanvasElement>('.canvas canvas[aria-hidden]')!
      const { data } = canvas.getContext('2d')!.getImageData(0, 0, canvas.width, canvas.height)
      return data.some((value) => value > 0)
    })
  await expect.poll(named).toBe(true)
  await page.keyboard.press('n')
  await expect.poll(named).toBe(false)
  await page.reload()
  await expect(page.getByRole('button', { name: 'Names' })).toHaveAttribute('aria-pressed', 'false')
  await page.keyboard.press('n')

  // The user's own hand ends it.
  await expect.poll(() => ask(page, ({ state }) => state.npcs.camera.value)).toBe(true)
  await page.keyboard.press('h')
  await expect(bar.getByRole('button', { name: 'Follow', exact: true })).toHaveAttribute('aria-pressed', 'false')
})

test('a link reopens the view: world, camera, NPC, layers, and the ends of the plan', async ({ page, context }) => {
  await context.grantPermissions(['clipboard-read', 'clipboard-write'])
  await openOnMap(page, scene)
  await withGraph(page)
  await page.getByRole('button', { name: 'Plan a path' }).click()
  await clickMap(page, 0.42, 0.4)
  await clickMap(page, 0.6, 0.6)
  await page.keyboard.press('1')
  await ask(page, ({ state, viewport }) => {
    state.npcs.select([...state.live.npcs.value.keys()][2])
    state.graphs.setFilter({ presence: 'full', colour: 'ability' })
    state.view.trails.value = false
    viewport!.setCamera({ target: { x: 80, y: 20, z: 90 }, distance: 33, azimuth: 1.5, polar: 0.8 })
  })
  await page.getByRole('button', { name: 'Copy link' }).click()
  await expect(page.getByText('The link was copied')).toBeVisible()
  const link = await page.evaluate(() => navigator.clipboard.readText())
  const view = (page: Page) =>
    ask(page, ({ state, viewport }) => {
      const { trails, names } = state.view
      const { start, goal } = state.plans
      const place = (at: { x: number; y: number; z: number } | undefined) =>
        at && [at.x, at.y, at.z].map((part) => part.toFixed(1))
      const camera = viewport!.camera()
      return JSON.stringify([
        String(state.worlds.chosenId.value),
        String(state.npcs.selectedId.value),
        state.npcs.camera.value,
        state.graphs.filter.value.presence,
        state.graphs.filter.value.colour,
        [trails.value, names.value],
        [place(start.value), place(goal.value), place(camera.target)],
        [camera.distance, camera.azimuth, camera.polar].map((part) => part.toFixed(1)),
      ])
    })
  const before = await view(page)

  // Beside the first: together they may not use up the six connections that browsers open to a server.
  const other = await context.newPage()
  await open(other, scene, new URL(link).hash)
  await expect.poll(() => view(other)).toBe(before)
  await expect(other.getByRole('tab', { name: 'Plan' })).toBeVisible()
  await expect.poll(() => ask(other, ({ state }) => state.plans.plans.value.length)).toBeGreaterThan(0)
  // What changes comes into the address, and a pasted address is opened.
  await other.keyboard.press('l')
  await expect.poll(() => other.evaluate(() => location.hash)).not.toContain('trails=0')
  await other.evaluate((hash) => (location.hash = hash), new URL(link).hash)
  await expect.poll(() => view(other)).toBe(before)
})

test('the tour is offered once, notices what is done, and starts again from the help', async ({ page }) => {
  await openAtFirst(page, scene)
  await page.getByRole('button', { name: 'Take the tour' }).click()
  const step = (title: string) => expect(page.getByRole('heading', { name: title })).toBeVisible()
  await step('Look around')
  const canvas = (await page.locator('canvas').first().boundingBox())!
  await page.mouse.move(canvas.x + 300, canvas.y + 150)
  await page.mouse.down()
  await page.mouse.move(canvas.x + 420, canvas.y + 190, { steps: 30 })
  await page.mouse.up()
  await step('Follow another NPC')
  await expect(page.locator('.tour-ring')).toBeVisible()
  const before = await selected(page)
  await page.keyboard.press('j')
  await expect.poll(() => selected(page)).not.toBe(before)
  await step('Ask for a plan')
  await page.getByRole('button', { name: 'End the tour' }).click()
  await openAtFirst(page, scene)
  await expect(page.getByRole('button', { name: 'Take the tour' })).toBeHidden()
  await page.keyboard.press('?')
  await page.getByRole('dialog').getByRole('button', { name: 'Take the tour' }).click()
  await step('Look around')
})

test('the last attempt of an NPC is replayed and can be scrubbed, while the world goes on', async ({ page }) => {
  await open(page, scene)
  // An attempt may be over at once; this one is to be watched.
  const seconds = () => ask(page, ({ state }) => state.npcs.followed.value?.history.at(-1)?.seconds ?? 0)
  await expect.poll(seconds, { timeout: 90_000 }).toBeGreaterThan(2)
  await page.keyboard.press('r')
  const bar = page.getByRole('group', { name: 'Replay' })
  await expect(bar).toContainText(/attempt \d+, /)
  const slider = bar.getByRole('slider')
  const shown = async () => Number(await slider.inputValue())
  await expect.poll(shown).toBeGreaterThan(0.2)
  // A moment that is chosen stops the replay.
  await slider.fill('0.1')
  const target = () => ask(page, ({ viewport }) => JSON.stringify(viewport!.camera().target))
  const tick = () => ask(page, ({ state }) => Number(state.live.moment.value.tick))
  const worldGoesOn = async () => {
    const before = await tick()
    await expect.poll(tick).toBeGreaterThan(before + 60)
  }
  // The camera glides to that moment and then stays, whatever the NPC does meanwhile.
  const isStill = async () => {
    const before = await target()
    await worldGoesOn()
    return (await target()) === before
  }
  await expect.poll(isStill).toBe(true)
  expect(await shown()).toBe(0.1)
  await bar.getByRole('button', { name: 'End the replay' }).click()
  await expect(bar).toBeHidden()
})

test('the motion of an attempt is plotted beside its replay, and the plots choose the moment', async ({ page }) => {
  await openOnMap(page, scene)
  await page.keyboard.press('m')
  const hint = page.getByRole('group', { name: 'Watch NPCs' }).getByRole('status')
  await expect(hint).toContainText('No NPC is selected')
  await page.keyboard.press('j')
  await expect(hint).toContainText('Press R')
  const seconds = () => ask(page, ({ state }) => state.npcs.followed.value?.history.at(-1)?.seconds ?? 0)
  await expect.poll(seconds, { timeout: 90_000 }).toBeGreaterThan(2)
  await page.keyboard.press('r')
  const motion = page.getByRole('group', { name: 'Motion' })
  const plots = motion.getByRole('slider')
  await expect(motion).toContainText(/Heading-?\d+°/)
  const share = () => ask(page, ({ state: { replays } }) => replays.seconds.value / replays.length.value)
  // A click stops the replay there, and a drag goes on to another moment.
  const box = (await plots.boundingBox())!
  await page.mouse.move(box.x + box.width / 4, box.y + box.height / 2)
  await page.mouse.down()
  expect(await share()).toBeCloseTo(0.25, 2)
  await page.mouse.move(box.x + box.width / 2, box.y + box.height / 2)
  await page.mouse.up()
  expect(await share()).toBeCloseTo(0.5, 2)
  await page.mouse.move(box.x, box.y)
  expect(await share()).toBeCloseTo(0.5, 2)
  await expect(plots).toHaveAttribute('aria-valuetext', /seconds: heading -?\d+°, \d+\.\d m\/s, \w+, leg: /)
  await page.screenshot({ path: 'test-results/motion.png' })
  await plots.press('End')
  expect(await share()).toBe(1)
  await page.keyboard.press('m')
  await expect(motion).toBeHidden()
  await expect(page.getByRole('group', { name: 'Replay' })).toBeVisible()
})

test('a picture and a clip of the view are saved', async ({ page }) => {
  await open(page, scene)
  const save = async (name: string) => {
    const download = page.waitForEvent('download')
    await page.getByRole('button', { name }).click()
    const file = await download
    return { name: file.suggestedFilename(), bytes: await readFile(await file.path()) }
  }
  const picture = await save('Save a picture')
  expect(picture.name).toMatch(/^surefoot .*\.png$/)
  expect([...picture.bytes.subarray(0, 4)]).toEqual([0x89, 0x50, 0x4e, 0x47])
  expect(picture.bytes.length).toBeGreaterThan(20_000)
  await page.getByRole('button', { name: 'Record a clip' }).click()
  await page.waitForTimeout(2500)
  const clip = await save('Stop and save the clip')
  expect(clip.name).toMatch(/\.webm$/)
  expect([...clip.bytes.subarray(0, 4)]).toEqual([0x1a, 0x45, 0xdf, 0xa3])
  expect(clip.bytes.length).toBeGreaterThan(20_000)
})
