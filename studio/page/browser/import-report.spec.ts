import { readFile } from 'node:fs/promises'
import { expect, type Page, test } from '@playwright/test'
import { ask, openOnMap, violations } from './page'
import { Scene } from './scene'

let scene: Scene
test.beforeAll(async () => {
  scene = await Scene.start()
})
test.afterAll(async () => {
  await scene.stop()
})

type Triple = [number, number, number]

/** Boxes of a level: name, centre and size, m. */
const BOXES: readonly [name: string, centre: Triple, size: Triple][] = [
  ['floor', [20, -0.5, 15], [40, 1, 30]],
  ['water_01', [8, 0.5, 8], [6, 1, 6]],
  ['Waterfront', [30, 1.5, 20], [6, 3, 4]],
  ['door_1', [20, 1.5, 15], [2, 3, 0.2]],
  ['Sky', [20, 18.5, 15], [38, 1, 28]],
]

/** The boxes as a .gltf: nodes that share the mesh of a unit cube. */
function quay(): Buffer {
  const corners = Array.from({ length: 8 }, (_, bits) => [bits & 1, (bits >> 1) & 1, (bits >> 2) & 1])
  const positions = Float32Array.from(corners.flat().map((part) => part - 0.5))
  const faces = [
    [0, 4, 6, 2],
    [1, 3, 7, 5],
    [0, 1, 5, 4],
    [2, 6, 7, 3],
    [0, 2, 3, 1],
    [4, 5, 7, 6],
  ]
  const indices = Uint16Array.from(faces.flatMap(([a, b, c, d]) => [a!, b!, c!, a!, c!, d!]))
  const content = Buffer.concat([Buffer.from(positions.buffer), Buffer.from(indices.buffer)])
  const level = {
    asset: { version: '2.0' },
    scene: 0,
    scenes: [{ nodes: BOXES.map((_, index) => index) }],
    nodes: BOXES.map(([name, translation, scale]) => ({ name, translation, scale, mesh: 0 })),
    meshes: [{ primitives: [{ attributes: { POSITION: 0 }, indices: 1 }] }],
    accessors: [
      { bufferView: 0, componentType: 5126, count: 8, type: 'VEC3', min: [-0.5, -0.5, -0.5], max: [0.5, 0.5, 0.5] },
      { bufferView: 1, componentType: 5123, count: indices.length, type: 'SCALAR' },
    ],
    bufferViews: [
      { buffer: 0, byteLength: positions.byteLength },
      { buffer: 0, byteOffset: positions.byteLength, byteLength: indices.byteLength },
    ],
    buffers: [
      {
        byteLength: content.length,
        uri: `data:application/octet-stream;base64,${content.toString('base64')}`,
      },
    ],
  }
  return Buffer.from(JSON.stringify(level))
}

const line = (page: Page, name: string) =>
  page.getByRole('list', { name: 'Nodes' }).getByRole('button', { name: new RegExp(`^${name}`) })

/** Says what the selected node is. */
const importAs = (page: Page, label: string) => page.getByLabel('Import it as').selectOption({ label })

/** What the sidecar says that is saved. */
async function saved(page: Page): Promise<unknown> {
  const download = page.waitForEvent('download')
  await page.getByRole('button', { name: 'Save the sidecar' }).click()
  const file = await download
  expect(file.suggestedFilename()).toBe('quay.surefoot.json')
  return JSON.parse(await readFile(await file.path(), 'utf8'))
}

const lavaPools = (page: Page) =>
  ask(page, ({ state }) => state.level.features.value?.pools.filter(({ lava }) => lava).length)

test('a designer reads what became of the nodes of a level, looks at one, and switches it', async ({ page }) => {
  await openOnMap(page, scene)
  const section = page.getByRole('region', { name: 'Import a level' })
  const jetpacks = [{ at: [5, 1, 25] }]
  await section.locator('input[type=file]').setInputFiles([
    { name: 'quay.gltf', mimeType: 'model/gltf+json', buffer: quay() },
    { name: 'quay.surefoot.json', mimeType: 'application/json', buffer: Buffer.from(JSON.stringify({ jetpacks })) },
  ])
  await section.getByRole('button', { name: 'Import' }).click()
  await section.getByRole('button', { name: 'Show the report' }).click()
  const report = page.getByRole('region', { name: 'Report' })
  await expect(report.getByRole('status')).toContainText('quay.gltf: 5 nodes: ')
  await expect(line(page, 'floor')).toContainText('solid')
  await expect(line(page, 'water_01')).toContainText('water')
  await expect(line(page, 'door_1')).toContainText('door')
  await report.getByRole('button', { name: 'Show the level' }).click()
  await expect.poll(() => ask(page, ({ state }) => state.level.features.value?.size.width)).toBe(44)

  // A line shows its node on the map; Esc takes it back.
  await line(page, 'Waterfront').focus()
  await page.keyboard.press('Enter')
  const box = () => ask(page, ({ state }) => state.selectedBox.value)
  const sizeOf = ({ low, high }: NonNullable<Awaited<ReturnType<typeof box>>>) =>
    [high.x - low.x, high.y - low.y, high.z - low.z].map((side) => Math.round(side * 100) / 100)
  expect(sizeOf((await box())!)).toEqual([6, 3, 4])
  const apart = () =>
    ask(page, ({ state, viewport }) => {
      const [{ target }, box] = [viewport!.camera(), state.selectedBox.value!]
      return Math.hypot(target.x - (box.low.x + box.high.x) / 2, target.z - (box.low.z + box.high.z) / 2)
    })
  expect(await apart()).toBeLessThan(4)
  await page.screenshot({ path: 'test-results/import-report.png' })
  await page.keyboard.press('Escape')
  expect(await box()).toBeUndefined()
  await expect(page.getByLabel('Import it as')).toBeHidden()

  // It becomes lava, in the report and in the view, which stays where it is.
  await line(page, 'Waterfront').click()
  await importAs(page, 'Lava')
  await expect(line(page, 'Waterfront')).toContainText('lava')
  await expect.poll(() => lavaPools(page)).toBe(1)
  await expect.poll(box).toBeDefined()
  await expect.poll(apart).toBeLessThan(4)
  expect(await violations(page)).toEqual([])
  await line(page, 'Sky').click()
  await importAs(page, 'Left out')
  await expect(line(page, 'Sky')).toContainText('left out')
  const nodes = { Waterfront: 'lava', Sky: 'leave_out' }
  expect(await saved(page)).toEqual({ jetpacks, nodes })
  // Earlier attempts leave no worlds behind.
  await expect.poll(() => ask(page, ({ state }) => state.worlds.list.value.length)).toBe(2)

  // Without names, only what the sidecar says counts.
  await report.getByLabel('Names have no meaning').check()
  await expect(line(page, 'water_01')).toContainText('solid')
  await expect(line(page, 'Waterfront')).toContainText('lava')
  expect(await saved(page)).toEqual({ jetpacks, nodes, names: false })

  // An entry is taken back from the keyboard's place, and a filter finds the line.
  await page.getByRole('region', { name: 'Nodes' }).getByLabel('Name').fill('front')
  await line(page, 'Waterfront').click()
  await importAs(page, 'As its name says')
  await expect(line(page, 'Waterfront')).toContainText('solid')
  await expect.poll(() => lavaPools(page)).toBe(0)
  await page.getByLabel('Import it as').press('Escape')
  await expect(line(page, 'Waterfront')).toBeFocused()
  expect(await saved(page)).toEqual({ jetpacks, nodes: { Sky: 'leave_out' }, names: false })

  // The level is called by its name.
  await page.getByRole('tab', { name: 'Map' }).click()
  await expect(page.getByRole('list', { name: 'Worlds' })).toContainText('quay.gltf')
})
