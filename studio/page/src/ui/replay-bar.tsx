import { useEffect } from 'preact/hooks'
import { outcomeName } from '../data/abilities'
import type { Studio } from '../data/studio'
import type { Replays } from '../data/world/replays'
import { npcNumber } from '../data/world/snapshot'
import { Button } from './controls'
import { MotionPlots } from './motion/motion-plots'
import { PlotsButton } from './motion/plots-button'

const STEP_S = 0.05

/** The scrubber of a replay, and above it its plots. */
export function ReplayBar({ studio }: { studio: Studio }) {
  const { replays } = studio
  const shown = replays.shown.value
  const isPlaying = replays.playing.value
  useEffect(() => (isPlaying ? keepPlaying(replays) : undefined), [replays, isPlaying])
  if (shown === undefined) return null
  const [seconds, length] = [replays.seconds.value, replays.length.value]
  const hasPlots = studio.view.plots.value
  const how = shown.outcome === undefined ? 'not ended' : outcomeName(shown.outcome).toLowerCase()
  return (
    <div class={`watch-bar replay-bar ${hasPlots ? 'with-plots' : ''}`} role="group" aria-label="Replay">
      <Button
        label={isPlaying ? 'Pause' : 'Play'}
        icon={isPlaying ? 'pause' : 'play'}
        bare
        onClick={() => replays.toggle()}
      />
      <p class="doing">
        <strong>NPC {npcNumber(shown.npcId)}</strong>
        <span>
          attempt {shown.attempt}, {how}
        </span>
        {shown.isCut && <span>(without its beginning)</span>}
      </p>
      <span class="number">
        {seconds.toFixed(1)} / {length.toFixed(1)} s
      </span>
      {hasPlots && <MotionPlots replays={replays} />}
      <input
        type="range"
        aria-label="Moment of the replay"
        aria-valuetext={`${seconds.toFixed(1)} of ${length.toFixed(1)} seconds`}
        min={0}
        max={length}
        step={STEP_S}
        value={seconds}
        onInput={(event) => replays.seek(event.currentTarget.valueAsNumber)}
      />
      <PlotsButton studio={studio} bare />
      <Button label="End the replay" icon="close" bare hint="End the replay (R)" onClick={() => replays.close()} />
    </div>
  )
}

function keepPlaying(replays: Replays): () => void {
  let before = performance.now()
  let request = requestAnimationFrame(function step(now) {
    replays.advance(Math.max(0, now - before) / 1000)
    before = now
    request = requestAnimationFrame(step)
  })
  return () => cancelAnimationFrame(request)
}
