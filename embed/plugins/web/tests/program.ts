// The program that rows, actions and plans are compared with, named by the variable SUREFOOT.

import { execFileSync, spawn } from 'node:child_process'
import { mkdtempSync, readFileSync, rmSync } from 'node:fs'
import { tmpdir } from 'node:os'
import path from 'node:path'
import { createInterface } from 'node:readline'

function program(): string {
  const named = process.env.SUREFOOT
  if (named === undefined)
    throw new Error('set SUREFOOT to the surefoot program, such as ../../target/release/surefoot')
  return named
}

/** A folder that is removed when `close` is called. */
export class Folder {
  private readonly path = mkdtempSync(path.join(tmpdir(), 'surefoot-web-'))

  file(name: string): string {
    return path.join(this.path, name)
  }

  close(): void {
    rmSync(this.path, { recursive: true, force: true })
  }
}

/** Runs a command to its end and returns what it prints. */
export function run(...args: string[]): string {
  return execFileSync(program(), args, { encoding: 'utf8', maxBuffer: 2 ** 28, stdio: ['ignore', 'pipe', 'ignore'] })
}

/** The ONNX file of a shipped model. */
export function exportOnnx(folder: Folder, model: string): Uint8Array {
  const file = folder.file(`${model}.onnx`)
  run('export', '--model', model, '--onnx', file)
  return new Uint8Array(readFileSync(file))
}

/** A service under test. */
export interface Service {
  url: string
  /** Ends it at once. */
  kill(): Promise<void>
}

/** Starts a service on a free port, or on that of `listen`, and waits until it is ready. */
export async function serve(command: 'serve' | 'plan', args: string[] = [], listen = '127.0.0.1:0'): Promise<Service> {
  const child = spawn(program(), [command, '--listen', listen, ...args], { stdio: ['ignore', 'ignore', 'pipe'] })
  const ended = new Promise<void>((resolve) => child.once('exit', () => resolve()))
  const kill = () => {
    child.kill('SIGKILL')
    return ended
  }
  for await (const line of createInterface({ input: child.stderr })) {
    const address = /ready.*address.*?=.*?(\d+\.\d+\.\d+\.\d+:\d+)/.exec(line)?.[1]
    if (address === undefined) continue
    // What it says from now on is not read, and must not fill the pipe.
    child.stderr.resume()
    return { url: `http://${address}`, kill }
  }
  throw new Error(`surefoot ${command} ended before it served`)
}
