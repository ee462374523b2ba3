import type { Studio } from '../../data/studio'
import { Button } from '../controls'

export function PlotsButton({ studio, bare = false }: { studio: Studio; bare?: boolean }) {
  return (
    <Button
      label="Motion"
      icon="plots"
      bare={bare}
      hint="Plot heading, speed and gait beside the replay (M)"
      pressed={studio.view.plots.value}
      onClick={() => studio.togglePlots()}
    />
  )
}

/** What to do where there is nothing to plot. */
export function PlotsHint({ isSelected }: { isSelected: boolean }) {
  return (
    <p class="motion-hint" role="status">
      {isSelected
        ? 'Press R to replay its last attempt and to plot its motion. If it has made none since this page was opened, send it somewhere first.'
        : 'No NPC is selected. Click one, or press J, and then R to plot its last attempt.'}
    </p>
  )
}
