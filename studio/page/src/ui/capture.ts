// Files that the page gives to the browser: pictures and clips of the view, and sidecars of levels.

import { signal } from '@preact/signals'
import { inWords } from '../data/net/errors'
import type { Studio } from '../data/studio'
import type { ClipRecording } from '../view/viewport.types'

/** A clip ends by itself after this time, so that it stays small. */
const MOST_CLIP_MS = 120_000
/** The browser reads the file by its address after the click. */
const ADDRESS_MS = 10_000

interface Recording {
  clip: ClipRecording
  end: ReturnType<typeof setTimeout>
}

/** The clip that is being recorded. */
export const recording = signal<Recording | undefined>(undefined)

export function giveFile(name: string, content: Blob): void {
  const link = document.createElement('a')
  link.href = URL.createObjectURL(content)
  link.download = name
  link.click()
  setTimeout(() => URL.revokeObjectURL(link.href), ADDRESS_MS)
}

export async function savePicture({ viewport, context }: Studio): Promise<void> {
  try {
    const picture = await viewport.peek()?.picture()
    if (picture !== undefined) giveFile(nameFor('png'), picture)
  } catch (error) {
    context.toasts.say(`No picture was saved: ${inWords(error)}`, 'bad')
  }
}

/** Begins a clip, or ends and saves it. */
export async function toggleClip(studio: Studio): Promise<void> {
  const { viewport, context } = studio
  try {
    const running = recording.peek()
    if (running === undefined) {
      const clip = viewport.peek()?.record()
      if (clip !== undefined) {
        recording.value = { clip, end: setTimeout(() => void toggleClip(studio), MOST_CLIP_MS) }
      }
      return
    }
    clearTimeout(running.end)
    recording.value = undefined
    const content = await running.clip.stop()
    giveFile(nameFor(content.type.includes('mp4') ? 'mp4' : 'webm'), content)
  } catch (error) {
    context.toasts.say(`No clip was saved: ${inWords(error)}`, 'bad')
  }
}

/** "surefoot 2026-11-26 06.31.05.png" */
function nameFor(ending: string): string {
  const time = new Date().toISOString().slice(0, 19).replace('T', ' ').replaceAll(':', '.')
  return `surefoot ${time}.${ending}`
}
