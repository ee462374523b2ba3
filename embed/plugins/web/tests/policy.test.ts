// Policies in the page against decisions that the program prints, and what is said about files that are none.

import { readFileSync } from 'node:fs'
import { afterAll, beforeAll, expect, test } from 'vitest'
import { OBSERVATION_LEN, Policy } from '../src/agents/index.ts'
import { exportOnnx, Folder, run } from './program.ts'

const ROWS = 50
const TOLERANCE = 1e-4
const folder = new Folder()

afterAll(() => folder.close())

/** What `surefoot export --check` prints: successive steps of some rows. */
interface Check {
  rows: number
  steps: { observations: number[]; actions: number[] }[]
}

for (const [model, memoryLen] of [
  ['general-reactive', 0],
  ['general-lstm', 64],
] as const) {
  test(`${model} decides as in the program`, async () => {
    const policy = await Policy.load(exportOnnx(folder, model))
    expect(policy.memoryLen).toBe(memoryLen)
    const { rows, steps } = JSON.parse(run('export', '--model', model, '--check', String(ROWS))) as Check
    let memories = new Float32Array(rows * 2 * memoryLen)
    for (const { observations, actions } of steps) {
      const decided = await policy.run(new Float32Array(observations), memories)
      memories = new Float32Array(decided.memories)
      actions.forEach((action, idx) => {
        expect(Math.abs(Math.tanh(decided.means[idx]!) - action)).toBeLessThanOrEqual(TOLERANCE)
      })
    }
  })
}

let reactive: Policy
beforeAll(async () => {
  reactive = await Policy.load(exportOnnx(folder, 'general-reactive'))
})

test('decisions that are asked for at once are made one after another', async () => {
  const memories = new Float32Array()
  const both = await Promise.all([
    reactive.run(new Float32Array(OBSERVATION_LEN), memories),
    reactive.run(new Float32Array(OBSERVATION_LEN).fill(0.5), memories),
  ])
  const alone = await reactive.run(new Float32Array(OBSERVATION_LEN).fill(0.5), memories)
  expect(both[1].means).toEqual(alone.means)
  expect(both[0].means).not.toEqual(alone.means)
})

test('what is no policy is refused with what to do', async () => {
  await expect(Policy.load(new Uint8Array([1, 2, 3]))).rejects.toThrow('cannot be read as ONNX')
  await expect(Policy.load('http://127.0.0.1:9/policy.onnx')).rejects.toThrow('surefoot export --onnx')
  const file = Buffer.from(readFileSync(folder.file('general-reactive.onnx')))
  const renamed = Buffer.from(file.toString('latin1').replaceAll('observations', 'observasions'), 'latin1')
  await expect(Policy.load(new Uint8Array(renamed))).rejects.toThrow('no policy of Surefoot')
})

test('rows of wrong lengths are refused', async () => {
  await expect(reactive.run(new Float32Array(100), new Float32Array())).rejects.toThrow('369 for each row')
  await expect(reactive.run(new Float32Array(369), new Float32Array(3))).rejects.toThrow('memories has 3 values')
})
