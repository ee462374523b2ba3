// Moves the player by the keys that are held, picture by picture, and the camera with it.

import { effect, untracked } from '@preact/signals'
import type { Studio } from '../data/studio'
import { isWalkKey, speedOf, velocityOfKeys } from '../data/world/walk'
import type { Place, Viewport } from '../view/viewport.types'
import { TEXT_FIELDS } from './keys'

/** Longest time that one picture moves the player by, s. */
const MOST_S = 0.1
/** When the player is put down, the camera looks at this height over its feet, and comes this near, m. */
const BREAST_M = 1.2
const NEAR_M = 16
/** What moves its own marker with the arrow keys. */
const ARROW_FIELDS = '[role=toolbar], [role=tablist], [role=radiogroup], input'

/** Moves the player for as long as there is one, until what is returned is called. */
export function walkWithKeys(studio: Studio, viewport: Viewport): () => void {
  return effect(() => {
    if (!studio.player.isThere.value) return undefined
    return untracked(() => begin(studio, viewport))
  })
}

function begin({ player }: Studio, viewport: Viewport): () => void {
  const held = new Set<string>()
  const ends = new AbortController()
  let isRunning = false
  let last = performance.now()
  let request = 0
  listen(ends.signal, held, (shift) => (isRunning = shift))
  const stand = () => {
    held.clear()
    player.stand()
  }
  window.addEventListener('blur', stand, { signal: ends.signal })
  document.addEventListener('visibilitychange', stand, { signal: ends.signal })
  const cast = (origin: Place, direction: Place) => viewport.distanceToGround(origin, direction)
  const frame = (now: number) => {
    const seconds = Math.min((now - last) / 1000, MOST_S)
    last = now
    const keys = velocityOfKeys(held, viewport.camera().azimuth, speedOf(isRunning))
    const moved = player.step(keys, isRunning, seconds, cast)
    if (moved.x !== 0 || moved.y !== 0 || moved.z !== 0) viewport.moveCamera(moved)
    request = requestAnimationFrame(frame)
  }
  request = requestAnimationFrame(frame)
  const { x, y, z } = player.at.peek()!
  viewport.lookAt({ x, y: y + BREAST_M, z }, NEAR_M)
  return () => {
    ends.abort()
    cancelAnimationFrame(request)
  }
}

/** Keeps `held` up to date. The camera, which also moves by these keys, does not hear of them. */
function listen(signal: AbortSignal, held: Set<string>, shifted: (shift: boolean) => void): void {
  const options = { capture: true, signal }
  const pressed = (event: KeyboardEvent) => {
    shifted(event.shiftKey)
    if (!isWalkKey(event.code) || event.ctrlKey || event.metaKey || event.altKey) return
    const fields = event.code.startsWith('Arrow') ? `${TEXT_FIELDS}, ${ARROW_FIELDS}` : TEXT_FIELDS
    if (event.target instanceof Element && event.target.closest(fields) !== null) return
    event.preventDefault()
    event.stopPropagation()
    held.add(event.code)
  }
  const released = (event: KeyboardEvent) => {
    shifted(event.shiftKey)
    held.delete(event.code)
  }
  window.addEventListener('keydown', pressed, options)
  window.addEventListener('keyup', released, options)
}
