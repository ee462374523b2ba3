import { figuresInWords, MOST_SECONDS } from '../data/plan/reach'
import type { Studio } from '../data/studio'
import { Button, Ramp, Slider } from './controls'
import { noGraphInWords } from './graph/no-graph'
import { secondsColour } from '../view/colours'

/** The area that an NPC reaches from the chosen place, below the map. */
export function ReachBar({ studio }: { studio: Studio }) {
  const { reach } = studio
  const seconds = reach.seconds.value
  const { text, isWarning } = reachInWords(studio)
  return (
    <div class="watch-bar reach-bar" role="group" aria-label="Reachable area">
      <p class="doing" role="status">
        <strong>Reachable area</strong>
        {text !== '' && <span class={isWarning ? 'warn' : ''}>{text}</span>}
      </p>
      <Slider
        label="Within"
        min={1}
        max={MOST_SECONDS}
        step={1}
        value={seconds}
        shown={`${seconds} s`}
        onInput={(value) => (reach.seconds.value = value)}
      />
      <Ramp colour={secondsColour} low="0 s" high={`${seconds} s`} />
      <Button label="Close the area" icon="close" bare onClick={() => studio.setTool('select')} />
    </div>
  )
}

/** What is reached, or why there is nothing to see; empty until there is a start. */
function reachInWords(studio: Studio): { text: string; isWarning: boolean } {
  const { reach, graphs } = studio
  const warning = (text: string) => ({ text, isWarning: true })
  const note = (text: string) => ({ text, isWarning: false })
  const graph = graphs.loaded.value
  if (graph === undefined) return warning(noGraphInWords(studio))
  if (reach.start.value === undefined) return note('')
  if (reach.state.value === 'failed') return warning(reach.failure.value)
  const figures = reach.figures.value
  if (figures === undefined) return note('Looking for what is reachable …')
  const words = figuresInWords(figures, graph.vertices.length - graph.removed.length)
  return figures.vertices === 0 ? warning(words) : note(words)
}
