// What all tests of the page do with it.

import { expect, type Page } from '@playwright/test'
import axe from 'axe-core'
import type { StudioHook } from '../src/main'
import type { Scene } from './scene'

/** Calls a function with what the page knows. */
export function ask<T>(page: Page, question: (studio: StudioHook) => T): Promise<T> {
  return page.evaluate(`(${question.toString()})(window.surefootStudio)`) as Promise<T>
}

/** Opens the page as on any visit but the first, with what stands behind the # of its address. */
export async function open(page: Page, scene: Scene, hash = ''): Promise<void> {
  await page.addInitScript(() => localStorage.setItem('surefoot.tour', 'seen'))
  await openAtFirst(page, scene, hash)
}

/** Opens the page as it is on the first visit. */
export async function openAtFirst(page: Page, scene: Scene, hash = ''): Promise<void> {
  await page.goto(scene.studio + hash)
  await page.waitForFunction(() => 'surefootStudio' in window)
  await expect.poll(() => ask(page, (studio) => studio.state.level.state.value.kind), { timeout: 60_000 }).toBe('ready')
}

/** Opens the page on the whole map with nothing selected. */
export async function openOnMap(page: Page, scene: Scene): Promise<void> {
  await open(page, scene)
  await expect.poll(() => ask(page, ({ state }) => state.opening.value)).toBe(false)
  await page.keyboard.press('Escape')
  await page.keyboard.press('h')
  await page.getByRole('tab', { name: 'Map' }).click()
}

/** Waits until the page has a graph that no build changes any more. */
export async function withGraph(page: Page): Promise<void> {
  const edges = () =>
    ask(page, ({ state }) => {
      const [loaded, summary] = [state.graphs.loaded.value?.edges.length ?? 0, state.graphs.summary.value]
      return summary?.expectedEdges === 0 && summary.edges === loaded ? loaded : 0
    })
  await expect.poll(edges, { timeout: 90_000 }).toBeGreaterThan(300)
}

/** What axe finds wrong with the page as it is now. */
export async function violations(page: Page): Promise<string[]> {
  if (!(await page.evaluate(() => 'axe' in window))) await page.evaluate(axe.source)
  const { violations } = await page.evaluate(() => (window as unknown as { axe: typeof axe }).axe.run())
  return violations.flatMap(({ id, help, nodes }) => nodes.map((node) => `${id}: ${help}: ${node.html.slice(0, 200)}`))
}

/** Clicks the map at shares of the width and the height of the canvas. */
export async function clickMap(page: Page, x: number, y: number): Promise<void> {
  const box = await page.locator('canvas').first().boundingBox()
  await page.mouse.click(box!.x + x * box!.width, box!.y + y * box!.height)
}
