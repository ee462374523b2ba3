import { chromium } from '@playwright/test'
const [, , url, out] = process.argv
const args = ['--no-sandbox', '--use-angle=swiftshader', '--enable-unsafe-swiftshader', '--disable-quic', '--no-first-run', '--disable-background-networking', '--disable-component-update', '--disable-sync']
const browser = await chromium.launch({ executablePath: '/usr/bin/chromium', args })
const wait = (page, ms) => page.waitForTimeout(ms)
async function fresh(options, path) {
  const page = await browser.newPage(options)
  page.on('pageerror', (e) => console.log('pageerror', e.message))
  await page.goto(url + (path ?? ''))
  const began = Date.now()
  await page.waitForFunction(() => 'surefootStudio' in window)
  await page.waitForFunction(() => surefootStudio.state.level.state.value.kind === 'ready', undefined, { timeout: 60000 })
  console.log(JSON.stringify(options.viewport), 'map ready after', Date.now() - began, 'ms')
  await page.waitForFunction(() => surefootStudio.state.graphs.loaded.value !== undefined, undefined, { timeout: 60000 })
  return page
}
let page = await fresh({ viewport: { width: 1280, height: 720 }, colorScheme: 'dark' })
await wait(page, 2500)
await page.screenshot({ path: out + '-dark.png' })
// Orbit for 5 s and read frames a second.
const canvas = await page.locator('canvas').first().boundingBox()
await page.getByRole('button', { name: 'Graph', exact: true }).click()
for (const graph of [false, true]) {
  if (graph) await page.getByRole('button', { name: 'Graph', exact: true }).click()
  const rates = []
  await page.mouse.move(canvas.x + 300, canvas.y + 300)
  await page.mouse.down()
  const end = Date.now() + 6000
  let i = 0
  while (Date.now() < end) {
    await page.mouse.move(canvas.x + 300 + 120 * Math.sin(i / 20), canvas.y + 300 + 20 * Math.cos(i / 20))
    i += 1
    if (i % 20 === 0) rates.push(await page.evaluate(() => surefootStudio.viewport.framesPerSecond()))
  }
  await page.mouse.up()
  console.log('orbiting, graph', graph, 'frames/s', rates.slice(2).map((r) => r.toFixed(0)).join(' '))
}
await wait(page, 3000)
console.log('still camera, NPCs moving, frames/s', await page.evaluate(() => surefootStudio.viewport.framesPerSecond()))
// Selected NPC, followed.
await page.evaluate(() => {
  const { state } = surefootStudio
  const [id] = [...state.live.npcs.value.values()].filter((n) => n.status === 2).map((n) => n.npcId)
  state.npcs.select(id)
  state.openTab('npcs')
  state.npcs.toggleCamera()
})
await wait(page, 4000)
await page.screenshot({ path: out + '-npc.png' })
await page.close()
page = await fresh({ viewport: { width: 1024, height: 768 }, hasTouch: true, colorScheme: 'light' })
await wait(page, 1500)
await page.getByRole('tab', { name: 'Graph' }).click()
await page.evaluate(() => {
  const { state } = surefootStudio
  const e = state.graphs.loaded.value.edges[100]
  state.graphs.select({ kind: 'edge', from: e.from, to: e.to })
  const at = state.graphs.position(e.from)
  surefootStudio.viewport.lookAt(at)
})
await wait(page, 2500)
await page.screenshot({ path: out + '-tablet.png' })
await browser.close()
