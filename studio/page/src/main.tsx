import { effect } from '@preact/signals'
import { render } from 'preact'
import type { Context } from './data/context'
import { plannerAddress, readPlannerName, worldAddress } from './data/net/address'
import { connectPlanner, connectWorld } from './data/net/services'
import { Session } from './data/net/session'
import { Studio } from './data/studio'
import { Toasts } from './data/toasts'
import './styles-theme.css'
import './styles-controls.css'
import './styles-panels.css'
import './styles-cards.css'
import './styles-dialogs.css'
import './styles-stage.css'
import './styles-layout.css'
import { App } from './ui/app'
import { listenToKeys } from './ui/keys'
import type { Viewport } from './view/viewport.types'

/** For tests and for curious users: the 3D view, and all that the page knows and can do. */
export interface StudioHook {
  /** Undefined until it stands, and where the browser cannot draw. */
  readonly viewport: Viewport | undefined
  readonly state: Studio
}

declare global {
  interface Window {
    surefootStudio: StudioHook
  }
}

/** What the browser keeps; undefined where it refuses to, as some do in private windows. */
function storage(kind: 'localStorage' | 'sessionStorage'): Storage | undefined {
  try {
    return window[kind]
  } catch {
    return undefined
  }
}

async function begin(): Promise<void> {
  const page = new URL(location.href)
  const session = new Session(storage('sessionStorage'))
  const leaving = new AbortController()
  const context: Context = {
    session,
    world: connectWorld(worldAddress(page), session),
    planner: connectPlanner(plannerAddress(await readPlannerName(), page), session),
    toasts: new Toasts(),
    store: storage('localStorage'),
    signal: leaving.signal,
  }
  const studio = new Studio(context)
  window.surefootStudio = {
    get viewport() {
      return studio.viewport.peek()
    },
    state: studio,
  }
  window.addEventListener('pagehide', (event) => {
    if (!event.persisted) leaving.abort()
  })
  const noticeVisibility = () => studio.setVisible(document.visibilityState === 'visible')
  noticeVisibility()
  document.addEventListener('visibilitychange', noticeVisibility)
  studio.view.followSystem(matchMedia('(prefers-color-scheme: dark)'))
  effect(() => {
    document.documentElement.dataset.theme = studio.view.dark.value ? 'dark' : 'light'
  })
  // No room for the panel beside the map: it is opened when it is wanted.
  studio.panelOpen.value = innerWidth > 820
  const root = document.getElementById('app')
  if (root === null) throw new Error('the page has no #app')
  listenToKeys(window, studio)
  render(<App studio={studio} />, root)
  studio.start()
}

void begin()
