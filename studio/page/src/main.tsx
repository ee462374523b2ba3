import { effect } from '@preact/signals'
import { render } from 'preact'
import type { Context } from './data/context'
import { readPlannerName } from './data/net/address'
import { chooseAddresses, ConfirmedOrigins } from './data/net/consent'
import { decodeLink } from './data/view-link'
import { watchPolicy } from './data/net/policy'
import { connectPlanner, connectWorld } from './data/net/services'
import { Sessions } from './data/net/session'
import { Studio } from './data/studio'
import { Toasts } from './data/toasts'
import './styles-theme.css'
import './styles-controls.css'
import './styles-panels.css'
import './styles-cards.css'
import './styles-dialogs.css'
import './styles-stage.css'
import './styles-motion.css'
import './styles-layout.css'
import './styles-tour.css'
import { App } from './ui/app'
import { askForConsent } from './ui/consent-prompt'
import { listenToKeys } from './ui/keys'
import { keepLinks } from './ui/links'
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
  const root = document.getElementById('app')
  if (root === null) throw new Error('the page has no #app')
  const page = new URL(location.href)
  const store = storage('localStorage')
  const addresses = await chooseAddresses(page, await readPlannerName(), new ConfirmedOrigins(store), (question) =>
    askForConsent(root, question),
  )
  const sessions = new Sessions(storage('sessionStorage'), page.origin)
  const leaving = new AbortController()
  let isHiding = false
  // What the page says as it goes arrives, even if the page is gone by then.
  const fetchToTheEnd: typeof fetch = (input, init) => fetch(input, { ...init, keepalive: isHiding })
  const context: Context = {
    world: connectWorld(addresses.world, sessions, fetchToTheEnd),
    planner: connectPlanner(addresses.planner, sessions),
    toasts: new Toasts(),
    store,
    signal: leaving.signal,
  }
  watchPolicy(document, [context.world, context.planner])
  const studio = new Studio(context)
  window.surefootStudio = {
    get viewport() {
      return studio.viewport.peek()
    },
    state: studio,
  }
  window.addEventListener('pagehide', (event) => {
    isHiding = true
    studio.setTool('select')
    if (!event.persisted) leaving.abort()
  })
  window.addEventListener('pageshow', () => (isHiding = false))
  const noticeVisibility = () => studio.setVisible(document.visibilityState === 'visible')
  noticeVisibility()
  document.addEventListener('visibilitychange', noticeVisibility)
  studio.view.followSystem(matchMedia('(prefers-color-scheme: dark)'))
  effect(() => {
    document.documentElement.dataset.theme = studio.view.dark.value ? 'dark' : 'light'
  })
  // No room for the panel beside the map: it is opened when it is wanted.
  studio.panelOpen.value = innerWidth > 820
  listenToKeys(window, studio)
  render(<App studio={studio} />, root)
  for (const refusal of addresses.refusals) context.toasts.say(refusal, 'bad')
  studio.start(decodeLink(page.hash))
  keepLinks(window, studio)
}

void begin()
