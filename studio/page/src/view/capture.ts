// Pictures and clips of the view: its layers laid over one another.

import type { ClipRecording } from './viewport.types'

const CLIP_HZ = 30
const CLIP_BITS_PER_SECOND = 10_000_000
/** What browsers record, the best first. */
const CLIP_TYPES = ['video/webm;codecs=vp9', 'video/webm;codecs=vp8', 'video/webm', 'video/mp4']

type Layers = readonly HTMLCanvasElement[]

function compose(into: HTMLCanvasElement, layers: Layers): void {
  const brush = into.getContext('2d')!
  for (const layer of layers) {
    brush.drawImage(layer, 0, 0, into.width, into.height)
  }
}

/** A canvas for the layers; videos need even sides. */
function canvasFor([first]: Layers): HTMLCanvasElement {
  const canvas = document.createElement('canvas')
  canvas.width = first!.width & ~1
  canvas.height = first!.height & ~1
  return canvas
}

/** A PNG of the layers, which have just been drawn. */
export function pictureOf(layers: Layers): Promise<Blob> {
  const canvas = canvasFor(layers)
  compose(canvas, layers)
  return new Promise((resolve, reject) =>
    canvas.toBlob((blob) => (blob ? resolve(blob) : reject(new Error('the browser made no picture'))), 'image/png'),
  )
}

/** Records the layers; `take` adds what has just been drawn. */
export class Clip implements ClipRecording {
  private readonly canvas: HTMLCanvasElement
  private readonly recorder: MediaRecorder
  private readonly parts: Blob[] = []
  private readonly whole: Promise<Blob>

  /** @throws Error if the browser cannot record. */
  constructor(
    private readonly layers: Layers,
    private readonly ended: () => void,
  ) {
    const mimeType = 'MediaRecorder' in window && CLIP_TYPES.find((type) => MediaRecorder.isTypeSupported(type))
    if (!mimeType) {
      throw new Error('this browser records no clips')
    }
    this.canvas = canvasFor(layers)
    const options = { mimeType, videoBitsPerSecond: CLIP_BITS_PER_SECOND }
    this.recorder = new MediaRecorder(this.canvas.captureStream(CLIP_HZ), options)
    this.whole = new Promise((resolve, reject) => {
      this.recorder.ondataavailable = ({ data }) => void this.parts.push(data)
      this.recorder.onstop = () => resolve(new Blob(this.parts, { type: mimeType }))
      this.recorder.onerror = () => reject(new Error('the browser stopped recording'))
    })
    this.recorder.start(1000)
  }

  take(): void {
    compose(this.canvas, this.layers)
  }

  stop(): Promise<Blob> {
    this.ended()
    if (this.recorder.state !== 'inactive') {
      this.recorder.stop()
    }
    return this.whole
  }
}
