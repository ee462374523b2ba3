// Levels of files: sent to the world server in parts, and imported.

import { signal } from '@preact/signals'
import { MapFormat, UpAxis } from '../../gen/surefoot/world/v1/maps_pb'
import { type Context, report } from '../context'
import { type Frame, type Mark, sidecarWith } from './marks'

/** Largest part of a file in one request: below what services accept in a message. */
export const CHUNK_BYTES = 512 * 1024

const FORMATS: Record<string, MapFormat> = {
  sfmap: MapFormat.SAVED,
  glb: MapFormat.GLTF,
  gltf: MapFormat.GLTF,
  obj: MapFormat.OBJ,
}

/** The format of a file by its name; undefined if it is none that can be imported. */
export function formatOf(fileName: string): MapFormat | undefined {
  return FORMATS[fileName.split('.').pop()?.toLowerCase() ?? '']
}

export interface ImportOptions {
  /** Metres per unit of the level. */
  scale: number
  up: UpAxis
  keepSides: boolean
}

export const USUAL_OPTIONS: ImportOptions = { scale: 1, up: UpAxis.Y, keepSides: false }

/** A level that was imported. */
export interface Imported {
  name: string
  mapHash: string
  extent: string
  warnings: readonly string[]
  /** How its coordinates became the map's; undefined for a saved map, which has no sidecar. */
  frame: Frame | undefined
  /** The list of its features as it was imported; empty if there was none. */
  sidecar: string
}

export class Levels {
  /** Share of the file that has arrived while one is sent. */
  readonly sent = signal<number | undefined>(undefined)
  readonly imported = signal<Imported | undefined>(undefined)

  /** The file of the last import, which comes again when features are marked on it. */
  private last: { file: File; options: ImportOptions } | undefined

  constructor(private readonly context: Context) {}

  /** Imports a level, with the list of its features where there is one; keeps what came of it. */
  async import(file: File, sidecar: File | undefined, options: ImportOptions): Promise<void> {
    try {
      await this.send(file, (await sidecar?.text()) ?? '', options)
    } catch (error) {
      report(this.context, `${file.name} was not imported`, error)
    }
  }

  /** Imports the last level once more, with marks beside the features that it had. Returns the hash of its new map. */
  async importWith(marks: readonly Mark[]): Promise<string | undefined> {
    const sidecar = this.sidecarWith(marks)
    if (this.last === undefined || sidecar === undefined) return undefined
    const before = this.imported.peek()
    try {
      await this.send(this.last.file, sidecar, this.last.options)
      return this.imported.peek()?.mapHash
    } catch (error) {
      this.imported.value = before
      report(this.context, 'The level was not imported with its marks', error)
      return undefined
    }
  }

  /** The content of the last level's .surefoot.json with these marks; undefined if it cannot have one. */
  sidecarWith(marks: readonly Mark[]): string | undefined {
    const imported = this.imported.peek()
    if (imported?.frame === undefined) return undefined
    return sidecarWith(imported.sidecar, marks, imported.frame)
  }

  private async send(file: File, sidecar: string, options: ImportOptions): Promise<void> {
    const format = formatOf(file.name)
    if (format === undefined) {
      this.context.toasts.say(`${file.name} is no level: .glb, .gltf, .obj and .sfmap files can be imported.`, 'bad')
      return
    }
    this.imported.value = undefined
    this.last = undefined
    this.sent.value = 0
    try {
      const uploadId = crypto.randomUUID()
      const { maps } = this.context.world
      for (let offset = 0; offset < file.size; offset += CHUNK_BYTES) {
        const data = new Uint8Array(await file.slice(offset, offset + CHUNK_BYTES).arrayBuffer())
        await maps.uploadChunk({ uploadId, offset: BigInt(offset), data })
        this.sent.value = (offset + data.length) / file.size
      }
      const answer = await maps.importMap({ name: file.name, format, uploadId, sidecar, ...options })
      const { mapHash = '', size } = answer.map ?? {}
      const extent = `${size?.width ?? 0} x ${size?.depth ?? 0} m, ${size?.height ?? 0} m high`
      const origin = format === MapFormat.SAVED ? undefined : answer.origin
      const frame = origin && { origin, scale: options.scale, up: options.up }
      this.last = { file, options }
      this.imported.value = { name: file.name, mapHash, extent, warnings: answer.warnings, frame, sidecar }
    } finally {
      this.sent.value = undefined
    }
  }
}
