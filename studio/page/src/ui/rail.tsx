import { useRef } from 'preact/hooks'
import { EDIT_TOOLS, type Studio, type Tool } from '../data/studio'
import { Icon, type IconName } from './icons'
import { TOOL_KEYS } from './keys'

const ICONS: Record<Tool, IconName> = {
  select: 'select',
  plan: 'plan',
  forbid: 'forbid',
  add: 'add',
  move: 'move',
  remove: 'remove',
  force: 'force',
  spawn: 'spawn',
  player: 'player',
  reach: 'reach',
  send: 'send',
  teleport: 'teleport',
  mark: 'add',
  build: 'add',
}

/** The tools. Arrow keys go from one to the next, as in any toolbar; Tab goes past them. */
export function Rail({ studio }: { studio: Studio }) {
  const bar = useRef<HTMLDivElement>(null)
  const current = studio.tool.value
  const focusable = TOOL_KEYS.some(({ tool }) => tool === current) ? current : 'select'
  const step = (event: KeyboardEvent) => {
    const by = { ArrowDown: 1, ArrowRight: 1, ArrowUp: -1, ArrowLeft: -1 }[event.key]
    if (by === undefined || bar.current === null) return
    event.preventDefault()
    const buttons = [...bar.current.querySelectorAll('button')]
    const at = buttons.indexOf(document.activeElement as HTMLButtonElement)
    buttons[(at + by + buttons.length) % buttons.length]?.focus()
  }
  return (
    <section class="rail" aria-label="Tools">
      <div role="toolbar" aria-label="Tools" aria-orientation="vertical" ref={bar} onKeyDown={step}>
        {TOOL_KEYS.map(({ key, tool, name }, index) => (
          <button
            key={tool}
            type="button"
            class={EDIT_TOOLS.has(tool) !== EDIT_TOOLS.has(TOOL_KEYS[index - 1]?.tool ?? tool) ? 'first' : ''}
            aria-label={name}
            aria-pressed={tool === current}
            aria-keyshortcuts={key}
            data-key={key}
            data-tour={`tool-${tool}`}
            title={`${name} (${key})`}
            tabIndex={tool === focusable ? 0 : -1}
            onClick={() => studio.setTool(tool)}
          >
            <Icon name={ICONS[tool]} size={20} />
          </button>
        ))}
      </div>
    </section>
  )
}
