// The example in a headless Chromium: a click, and the NPC arrives.

import { fileURLToPath } from 'node:url'
import { type Browser, chromium, type Page } from 'playwright-core'
import { afterAll, beforeAll, expect, test } from 'vitest'
import { createServer, type ViteDevServer } from 'vite'

const EXAMPLE = fileURLToPath(new URL('../examples/three', import.meta.url))
const ARRIVAL_MS = 90_000

let server: ViteDevServer
let browser: Browser
let page: Page
const errors: string[] = []

beforeAll(async () => {
  server = await createServer({ root: EXAMPLE, server: { port: 0 }, logLevel: 'error' })
  await server.listen()
  browser = await chromium.launch({
    executablePath: process.env.CHROMIUM ?? '/usr/bin/chromium',
    args: ['--no-sandbox', '--use-angle=swiftshader', '--enable-unsafe-swiftshader', '--disable-background-networking'],
  })
  page = await browser.newPage({ viewport: { width: 640, height: 480 } })
  page.on('pageerror', (error) => errors.push(error.message))
  page.on('console', (message) => message.type() === 'error' && errors.push(message.text()))
  await page.goto(server.resolvedUrls!.local[0]!)
})

afterAll(async () => {
  await browser?.close()
  await server?.close()
})

/** Waits until the page says something, and returns the place of the NPC's feet. */
async function status(pattern: RegExp): Promise<number[]> {
  const output = page.locator('output')
  await expect
    .poll(() => output.textContent(), { timeout: ARRIVAL_MS, message: `errors of the page: ${errors.join('; ')}` })
    .toMatch(pattern)
  return (await output.textContent())!.split(' ').slice(-3).map(Number)
}

test('the NPC runs through the gap in the wall to where one clicks', async () => {
  const start = await status(/^idle at/)
  // Beyond the wall, on the floor before the steps.
  await page.mouse.click(330, 170)
  await status(/^walking/)
  const arrived = await status(/^arrived/)
  expect(start[2]).toBeGreaterThan(1)
  expect(arrived[2]).toBeLessThan(-1)
  expect(errors).toEqual([])
})

test('the NPC jumps up the steps to the platform', async () => {
  await page.mouse.click(165, 105)
  await status(/^walking/)
  const [, height] = await status(/^arrived/)
  expect(height).toBeGreaterThan(3.5)
  expect(errors).toEqual([])
})
