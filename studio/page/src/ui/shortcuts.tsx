import type { Studio } from '../data/studio'
import { Dialog } from './dialog'
import { OTHER_KEYS, TOOL_KEYS } from './keys'

export function Shortcuts({ studio }: { studio: Studio }) {
  if (!studio.helpOpen.value) return null
  const rows = [...TOOL_KEYS.map(({ key, name }) => ({ keys: key, does: name })), ...OTHER_KEYS]
  return (
    <Dialog title="Keyboard shortcuts" onClose={() => (studio.helpOpen.value = false)}>
      <dl class="shortcuts">
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
      </p>
    </Dialog>
  )
}
