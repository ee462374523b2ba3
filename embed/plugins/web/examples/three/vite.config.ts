// Serves the example. Before that, the surefoot program writes the two files that it needs: the policy, and the graph of its level.

import { execFileSync } from 'node:child_process'
import { existsSync, mkdirSync, writeFileSync } from 'node:fs'
import path from 'node:path'
import { fileURLToPath } from 'node:url'
import { defineConfig } from 'vite'
import { levelObj } from './level.ts'

const FOLDER = path.join(fileURLToPath(new URL('.', import.meta.url)), 'public')
const BUILT = fileURLToPath(new URL('../../../../../target/release/surefoot', import.meta.url))

/** The program: named by SUREFOOT, or built in this repository, or installed. */
const program = process.env.SUREFOOT ?? (existsSync(BUILT) ? BUILT : 'surefoot')

function surefoot(...args: string[]): void {
  try {
    execFileSync(program, args, { cwd: FOLDER, stdio: 'inherit' })
  } catch (error) {
    throw new Error(`${program} failed: set SUREFOOT to the surefoot program`, { cause: error })
  }
}

function prepare(): void {
  mkdirSync(FOLDER, { recursive: true })
  if (!existsSync(path.join(FOLDER, 'policy.onnx'))) surefoot('export', '--onnx', 'policy.onnx')
  if (existsSync(path.join(FOLDER, 'graph.json'))) return
  writeFileSync(path.join(FOLDER, 'level.obj'), levelObj())
  surefoot('graph', 'export', 'level.obj', '--vertices', '100', '--format', 'json', '--out', 'graph.json')
}

export default defineConfig(() => {
  // vite looks once for the files of its public folder, as soon as it knows its configuration.
  prepare()
  return {
    // Relative addresses work below any path.
    base: './',
    // It finds its WebAssembly file beside itself.
    optimizeDeps: { exclude: ['onnxruntime-web'] },
    build: { target: 'es2022', chunkSizeWarningLimit: 1200 },
  }
})
