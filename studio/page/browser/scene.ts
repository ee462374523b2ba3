// A real `surefoot up` for the tests of the page: one map, a few NPCs, its cache in a folder of its own.

import { type ChildProcess, spawn } from 'node:child_process'
import { once } from 'node:events'
import { existsSync, mkdtempSync, rmSync } from 'node:fs'
import { tmpdir } from 'node:os'
import path from 'node:path'
import { createInterface } from 'node:readline'
import { fileURLToPath } from 'node:url'

const ROOT = fileURLToPath(new URL('../../..', import.meta.url))

/** The program: named by SUREFOOT, or the one that was built last for tests. */
function program(): string {
  const found = [
    process.env.SUREFOOT,
    path.join(ROOT, 'target/debug/surefoot'),
    path.join(ROOT, 'target/release/surefoot'),
  ]
  const there = found.find((file) => file !== undefined && existsSync(file))
  if (there === undefined) throw new Error('build surefoot first: cargo build --workspace')
  return there
}

export class Scene {
  private constructor(
    private readonly cache: string,
    private process: ChildProcess,
    readonly studio: string,
    readonly planner: string,
  ) {}

  static async start(): Promise<Scene> {
    const cache = mkdtempSync(path.join(tmpdir(), 'surefoot-studio-'))
    const { process, studio, planner } = await run(cache, '127.0.0.1:0', '127.0.0.1:0')
    return new Scene(cache, process, studio, planner)
  }

  /** Ends it at once, as a power cut would. */
  async kill(): Promise<void> {
    const ended = once(this.process, 'exit')
    this.process.kill('SIGKILL')
    await ended
  }

  /** Starts it again at the same addresses. */
  async restart(): Promise<void> {
    this.process = (await run(this.cache, new URL(this.studio).host, new URL(this.planner).host)).process
  }

  async stop(): Promise<void> {
    await this.kill()
    rmSync(this.cache, { recursive: true, force: true })
  }
}

async function run(cache: string, listen: string, plannerListen: string) {
  const args = [
    'up',
    '--maps',
    '1',
    '--npcs',
    '8',
    '--cache',
    cache,
    '--listen',
    listen,
    '--planner-listen',
    plannerListen,
  ]
  const process = spawn(program(), args, { stdio: ['ignore', 'ignore', 'pipe'] })
  const found: Record<string, string> = {}
  const lines = createInterface({ input: process.stderr! })
  for await (const line of lines) {
    const [, name, address] = /^(planner|Studio)\s+(\S+)/.exec(line) ?? []
    if (name !== undefined && address !== undefined) found[name] = address
    if (line.includes('not in this build')) throw new Error(`this surefoot has no page: ${line}`)
    if (found.Studio !== undefined && found.planner !== undefined && line.includes('ready after')) break
  }
  const { Studio: studio, planner } = found
  if (studio === undefined || planner === undefined) throw new Error('surefoot up ended before it served')
  // What it says from now on is not read, and must not fill the pipe.
  process.stderr!.resume()
  return { process, studio, planner }
}
