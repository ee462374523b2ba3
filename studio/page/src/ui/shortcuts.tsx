import type { Studio } from '../data/studio'
import { Button } from './controls'
import { Dialog } from './dialog'
import { OTHER_KEYS, PLAYER_KEYS, TOOL_KEYS } from './keys'

/** The help: the tour and all keys. */
export function Shortcuts({ studio }: { studio: Studio }) {
  if (!studio.helpOpen.value) return null
  const rows = [...TOOL_KEYS.map(({ key, name }) => ({ keys: key, does: name })), ...PLAYER_KEYS, ...OTHER_KEYS]
  const close = () => (studio.helpOpen.value = false)
  const startTour = () => {
    close()
    studio.tour.start()
  }
  return (
    <Dialog title="Help" onClose={close}>
      <div class="row">
        <p class="note">The tour takes two minutes.</p>
        <span class="spring" />
        <Button label="Take the tour" icon="play" tone="main" onClick={startTour} />
      </div>
      <dl class="shortcuts" aria-label="Keyboard shortcuts">
        {rows.map(({ keys, does }) => (
          <div key={keys}>
            <dt>
              {keys.split(' ').map((key) => (
                <kbd key={key}>{key}</kbd>
              ))}
            </dt>
            <dd>{does}</dd>
          </div>
        ))}
      </dl>
      <p class="note">
        In the view: drag to orbit, drag with the right button or two fingers to pan, turn the wheel or pinch to zoom.
        With the view focused: arrow keys or W A S D pan, Q and E orbit, + and - zoom.
      </p>
    </Dialog>
  )
}
