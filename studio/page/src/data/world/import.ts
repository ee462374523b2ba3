// Levels of files: sent to the world server in parts, and imported.

import { batch, computed, signal } from '@preact/signals'
import { type GeometryCounts, type ImportedNode, MapFormat, UpAxis } from '../../gen/surefoot/world/v1/maps_pb'
import { type Context, report } from '../context'
import { type Frame, type Mark, sidecarWith } from './marks'
import { inOrder } from './report'
import { readSidecar, type Sidecar, writeSidecar } from './sidecar'

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
  /** The nodes of all scenes of a glTF, not only of its default scene. */
  allScenes: boolean
}

export const USUAL_OPTIONS: ImportOptions = { scale: 1, up: UpAxis.Y, keepSides: false, allScenes: false }

/** A level that was imported. */
export interface Imported {
  name: string
  mapHash: string
  extent: string
  warnings: readonly string[]
  /** What became of its nodes, in the order of the list. */
  nodes: readonly ImportedNode[]
  geometry: GeometryCounts | undefined
  /** How its coordinates became the map's; undefined for a saved map, which has no sidecar. */
  frame: Frame | undefined
  /** Content of the sidecar that it was imported with; empty if there was none. */
  sidecar: string
}

/** The file of a level, and how it is read. */
interface Source {
  file: File
  format: MapFormat
  options: ImportOptions
}

export class Levels {
  /** Share of the file that has arrived while one is sent. */
  readonly sent = signal<number | undefined>(undefined)
  readonly imported = signal<Imported | undefined>(undefined)
  /** Content of the sidecar as the user wants it. */
  readonly sidecar = signal('')
  /** Whether the level is imported again and its new map comes into view. */
  readonly isBusy = signal(false)
  /** Index of the selected node. */
  readonly selected = signal<number | undefined>(undefined)
  /** The wanted sidecar while the level has yet to be imported with it. */
  readonly unsent = computed(() => {
    const [imported, wanted] = [this.imported.value, this.sidecar.value]
    const isIdle = this.sent.value === undefined && !this.isBusy.value
    return isIdle && imported !== undefined && imported.sidecar !== wanted ? wanted : undefined
  })

  /** The level that comes again when its sidecar changes. */
  private last: Source | undefined

  constructor(private readonly context: Context) {}

  /** Imports a level, with its sidecar where there is one; keeps what came of it. */
  async import(file: File, sidecar: File | undefined, options: ImportOptions): Promise<void> {
    const format = formatOf(file.name)
    if (format === undefined) {
      this.context.toasts.say(`${file.name} is no level: .glb, .gltf, .obj and .sfmap files can be imported.`, 'bad')
      return
    }
    this.forget()
    const source = { file, format, options }
    try {
      const text = (await sidecar?.text()) ?? ''
      const imported = await this.send(source, text)
      this.last = source
      batch(() => {
        this.imported.value = imported
        this.sidecar.value = text
      })
    } catch (error) {
      report(this.context, `${file.name} was not imported`, error)
    }
  }

  /** Imports the last level with another sidecar. If it is refused, all stays as it is. */
  async again(sidecar: string): Promise<Imported | undefined> {
    const [before, last] = [this.imported.peek(), this.last]
    if (before === undefined || last === undefined) return undefined
    this.sidecar.value = sidecar
    try {
      const imported = await this.send(last, sidecar, before.nodes)
      // The user may have gone on to another file.
      if (this.imported.peek() !== before) return undefined
      this.imported.value = imported
      return imported
    } catch (error) {
      if (this.imported.peek() === before) this.sidecar.value = before.sidecar
      report(this.context, 'The level was not imported with this change', error)
      return undefined
    }
  }

  /** Changes the wanted sidecar. */
  edit(change: (sidecar: Sidecar) => Sidecar): void {
    this.sidecar.value = writeSidecar(change(readSidecar(this.sidecar.peek())))
  }

  forget(): void {
    batch(() => {
      this.imported.value = undefined
      this.selected.value = undefined
      this.sidecar.value = ''
    })
    this.last = undefined
  }

  /** The wanted sidecar with these marks; undefined if the level cannot have one. */
  sidecarWith(marks: readonly Mark[]): string | undefined {
    const frame = this.imported.peek()?.frame
    const wanted = this.sidecar.peek()
    if (frame === undefined) return undefined
    return marks.length === 0 ? wanted : sidecarWith(wanted, marks, frame)
  }

  private async send(
    { file, format, options }: Source,
    sidecar: string,
    earlier?: readonly ImportedNode[],
  ): Promise<Imported> {
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
      const { mapHash = '', name = '', size } = answer.map ?? {}
      const origin = format === MapFormat.SAVED ? undefined : answer.origin
      return {
        name: name || file.name,
        mapHash,
        extent: `${size?.width ?? 0} x ${size?.depth ?? 0} m, ${size?.height ?? 0} m high`,
        warnings: answer.warnings,
        nodes: inOrder(answer.nodes, earlier),
        geometry: answer.geometry,
        frame: origin && { origin, scale: options.scale, up: options.up },
        sidecar,
      }
    } finally {
      this.sent.value = undefined
    }
  }
}
