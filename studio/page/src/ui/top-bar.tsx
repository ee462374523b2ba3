import type { Studio } from '../data/studio'
import type { ThemeChoice } from '../data/view-settings'
import type { LinkState } from '../data/net/link'
import { Button } from './controls'
import { Icon, type IconName } from './icons'
import { copyLink } from './links'

export function TopBar({ studio }: { studio: Studio }) {
  const { layers } = studio
  return (
    <header class="top-bar">
      <h1>
        <Icon name="trails" />
        Surefoot <span>Studio</span>
      </h1>
      <WorldPicker studio={studio} />
      <div class="group" role="group" aria-label="Edits" data-tour="undo">
        <Button
          label="Undo"
          icon="undo"
          bare
          hint="Undo (Ctrl Z)"
          disabled={!layers.canUndo.value}
          onClick={() => void layers.undo()}
        />
        <Button
          label="Redo"
          icon="redo"
          bare
          hint="Redo (Ctrl Shift Z)"
          disabled={!layers.canRedo.value}
          onClick={() => void layers.redo()}
        />
      </div>
      <span class="saving" role="status">
        {layers.saving.value > 0 ? 'Saving …' : ''}
      </span>
      <span class="spring" />
      <LinkDot name="World server" state={studio.context.world.link.state.value} />
      <LinkDot name="Planner" state={studio.context.planner.link.state.value} />
      <Button
        label="Copy link"
        icon="link"
        bare
        hint="Copy a link to this view (C)"
        onClick={() => void copyLink(window, studio)}
      />
      <ThemeButton studio={studio} />
      <Button
        label="Token"
        icon="key"
        bare
        onClick={() => studio.context.world.session.ask('Enter the token of this page.')}
      />
      <Button
        label="Help"
        icon="help"
        bare
        hint="Help: tour and keys (?)"
        onClick={() => (studio.helpOpen.value = true)}
      />
      <Button
        label="Side panel"
        icon="panel"
        bare
        pressed={studio.panelOpen.value}
        onClick={() => (studio.panelOpen.value = !studio.panelOpen.value)}
      />
    </header>
  )
}

function WorldPicker({ studio: { worlds } }: { studio: Studio }) {
  const list = worlds.list.value
  if (list.length === 0) return null
  return (
    <select
      class="world-picker"
      aria-label="World"
      value={String(worlds.chosenId.value ?? '')}
      onChange={(event) => worlds.choose(BigInt(event.currentTarget.value))}
    >
      {list.map((world) => (
        <option key={world.worldId} value={String(world.worldId)}>
          World {String(world.worldId)}: {worlds.nameOf(world)}
        </option>
      ))}
    </select>
  )
}

const STATE_WORDS: Record<LinkState, string> = { connecting: 'connecting', live: 'connected', lost: 'not reachable' }

function LinkDot({ name, state }: { name: string; state: LinkState }) {
  return (
    <span class={`link ${state}`} role="status" title={`${name}: ${STATE_WORDS[state]}`}>
      <i />
      <span class="link-name">{name}</span>
      <span class="hidden">{STATE_WORDS[state]}</span>
    </span>
  )
}

const THEMES: Record<ThemeChoice, { next: ThemeChoice; icon: IconName; name: string }> = {
  auto: { next: 'dark', icon: 'system', name: 'as the system' },
  dark: { next: 'light', icon: 'moon', name: 'dark' },
  light: { next: 'auto', icon: 'sun', name: 'light' },
}

function ThemeButton({ studio: { view } }: { studio: Studio }) {
  const { next, icon, name } = THEMES[view.theme.value]
  return <Button label={`Theme: ${name}`} icon={icon} bare onClick={() => view.setTheme(next)} />
}
