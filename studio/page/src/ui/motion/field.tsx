import type { ComponentChildren, TargetedPointerEvent } from 'preact'
import type { Replays } from '../../data/world/replays'

/** By a key, s. */
const [STEP_S, PAGE_S] = [0.05, 1]
/** Keys that move the moment, by how much. */
const KEYS: Record<string, number> = {
  ArrowLeft: -STEP_S,
  ArrowDown: -STEP_S,
  ArrowRight: STEP_S,
  ArrowUp: STEP_S,
  PageDown: -PAGE_S,
  PageUp: PAGE_S,
  Home: -Infinity,
  End: Infinity,
}

/** The plots over one time axis, with a cursor at the moment that is shown. `text`: the values there. */
export function Field({ replays, text, children }: { replays: Replays; text: string; children: ComponentChildren }) {
  const [seconds, length] = [replays.seconds.value, replays.length.value]
  const seek = (event: TargetedPointerEvent<HTMLElement>) => {
    const { left, width } = event.currentTarget.getBoundingClientRect()
    replays.seek(((event.clientX - left) / width) * length)
  }
  return (
    <div
      class="motion-field"
      role="slider"
      tabIndex={0}
      aria-label="Moment in the plots"
      aria-valuemin={0}
      aria-valuemax={length}
      aria-valuenow={seconds}
      aria-valuetext={`${seconds.toFixed(1)} seconds: ${text}`}
      onPointerDown={(event) => {
        event.currentTarget.setPointerCapture(event.pointerId)
        seek(event)
      }}
      onPointerMove={(event) => {
        if (event.currentTarget.hasPointerCapture(event.pointerId)) seek(event)
      }}
      onKeyDown={(event) => {
        const step = KEYS[event.key]
        if (step === undefined) return
        event.preventDefault()
        replays.seek(replays.seconds.peek() + step)
      }}
    >
      {children}
      <i class="motion-cursor" style={{ left: `${length > 0 ? (seconds / length) * 100 : 0}%` }} />
    </div>
  )
}
