// A policy as `surefoot export --onnx` writes it, run by onnxruntime-web.

import * as ort from 'onnxruntime-web/wasm'
import { checkLength, SurefootError } from '../checks.ts'
import { OBSERVATION_LEN } from './observation.ts'

/** Values of an action: forward, strafe, turn, jump. */
export const ACTION_LEN = 4
const OUTPUTS = ['action', 'mean', 'log_std']

/** What a policy makes of a batch of observations, row by row. */
export interface Decided {
  /** The Gaussian before tanh, of which the most likely action is the mean. */
  means: Float32Array
  /** Logarithms of its deviations. */
  logStds: Float32Array
  /** What agents remember from now on: `2 * memoryLen` values a row, none for a policy without memory. */
  memories: Float32Array
}

export class Policy {
  /** Runs one after another: a session takes one at a time. */
  private queue: Promise<unknown> = Promise.resolve()

  private constructor(
    private readonly session: ort.InferenceSession,
    /** Values of each of the two halves of what an agent remembers; 0 for a policy without memory. */
    readonly memoryLen: number,
  ) {}

  /**
   * Loads a policy from the address or the contents of a file that `surefoot export --onnx` wrote.
   * @throws SurefootError if there is no such file, or it is none of these.
   */
  static async load(model: string | URL | Uint8Array): Promise<Policy> {
    const bytes = model instanceof Uint8Array ? model : await download(model)
    let session: ort.InferenceSession
    try {
      session = await ort.InferenceSession.create(bytes)
    } catch (error) {
      throw new SurefootError(`the policy cannot be read as ONNX: ${inWords(error)}`, { cause: error })
    }
    return new Policy(session, memoryLenOf(session))
  }

  /** Decides for a batch: `OBSERVATION_LEN` values a row, and `2 * memoryLen` of memory, zeros at first. */
  async run(observations: Float32Array, memories: Float32Array): Promise<Decided> {
    const rows = observations.length / OBSERVATION_LEN
    if (!Number.isInteger(rows) || rows === 0) {
      const message = `observations have ${observations.length} values, but must have ${OBSERVATION_LEN} for each row`
      throw new SurefootError(message)
    }
    checkLength('memories', memories, rows * 2 * this.memoryLen)
    const turn = this.queue.then(() => this.session.run(this.feeds(rows, observations, memories)))
    this.queue = turn.catch(() => undefined)
    const results = await turn
    return {
      means: values(results.mean),
      logStds: values(results.log_std),
      memories: this.memoryLen === 0 ? memories : this.interleave(results, rows),
    }
  }

  private feeds(rows: number, observations: Float32Array, memories: Float32Array): Record<string, ort.Tensor> {
    const feeds: Record<string, ort.Tensor> = { observations: new ort.Tensor(observations, [rows, OBSERVATION_LEN]) }
    if (this.memoryLen === 0) return feeds
    const shape = [rows, this.memoryLen]
    const half = (first: number) => {
      const half = new Float32Array(rows * this.memoryLen)
      for (let row = 0; row < rows; row++) {
        const from = (2 * row + first) * this.memoryLen
        half.set(memories.subarray(from, from + this.memoryLen), row * this.memoryLen)
      }
      return half
    }
    return { ...feeds, hidden_in: new ort.Tensor(half(0), shape), cell_in: new ort.Tensor(half(1), shape) }
  }

  /** Puts both halves of each row's memory side by side. */
  private interleave(results: ort.InferenceSession.OnnxValueMapType, rows: number): Float32Array {
    const [hidden, cell, len] = [values(results.hidden_out), values(results.cell_out), this.memoryLen]
    const memories = new Float32Array(rows * 2 * len)
    for (let row = 0; row < rows; row++) {
      memories.set(hidden.subarray(row * len, (row + 1) * len), 2 * row * len)
      memories.set(cell.subarray(row * len, (row + 1) * len), (2 * row + 1) * len)
    }
    return memories
  }
}

async function download(address: string | URL): Promise<Uint8Array> {
  const missing = (why: string, cause?: unknown) =>
    new SurefootError(`there is no policy at ${address} (${why}): write one there with surefoot export --onnx`, {
      cause,
    })
  let response: Response
  try {
    response = await fetch(address)
  } catch (error) {
    throw missing(inWords(error), error)
  }
  if (!response.ok) throw missing(`${response.status} ${response.statusText}`)
  return new Uint8Array(await response.arrayBuffer())
}

/** The length of a policy's memory, from the shapes of its inputs, which are checked. */
function memoryLenOf(session: ort.InferenceSession): number {
  const inputs = new Map(session.inputMetadata.map((input) => [input.name, input]))
  const width = (name: string) => {
    const input = inputs.get(name)
    return input?.isTensor ? Number(input.shape[1]) : 0
  }
  if (!inputs.has('observations') || OUTPUTS.some((name) => !session.outputNames.includes(name))) {
    throw new SurefootError('the ONNX model is no policy of Surefoot: make one with surefoot export --onnx')
  }
  if (width('observations') !== OBSERVATION_LEN) {
    const message = `the policy expects observations of ${width('observations')} values, but pages make those of ${OBSERVATION_LEN}`
    throw new SurefootError(`${message}: export one that does not see others, such as general-reactive`)
  }
  return width('hidden_in')
}

function values(output: ort.OnnxValue | undefined): Float32Array {
  if (output?.data instanceof Float32Array) return output.data
  throw new SurefootError('the policy lacks an output: export it again with surefoot export --onnx')
}

function inWords(error: unknown): string {
  return error instanceof Error ? error.message : String(error)
}
