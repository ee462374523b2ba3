// The view's link: kept behind the # of the page's address, copied, and opened.

import { effect } from '@preact/signals'
import { linkOf } from '../data/opening'
import type { Studio } from '../data/studio'
import { decodeLink, encodeLink } from '../data/view-link'

/** How often the address follows the camera, ms. Browsers limit how often it may change. */
const KEEP_MS = 1000

/** Keeps the link of the view behind the #, and opens what the user puts there. */
export function keepLinks(page: Window, studio: Studio): void {
  effect(() => note(page, studio))
  setInterval(() => note(page, studio), KEEP_MS)
  page.addEventListener('hashchange', () => {
    const link = decodeLink(page.location.hash)
    if (link !== undefined) studio.openLink(link)
  })
}

/** Copies the link of the view, or says where it is. */
export async function copyLink(page: Window, studio: Studio): Promise<void> {
  note(page, studio)
  const { toasts } = studio.context
  try {
    await page.navigator.clipboard.writeText(page.location.href)
    toasts.say('The link was copied. It opens this view.', 'good')
  } catch {
    // Pages that do not come over TLS or from this machine have no clipboard.
    toasts.say('The browser does not copy here. The link is in the address bar.')
  }
}

function note(page: Window, studio: Studio): void {
  // Until its view has opened, the address keeps the link that it came with.
  const isOpening = studio.link.value !== undefined
  const link = isOpening || page.document.hidden ? undefined : linkOf(studio)
  if (link === undefined) return
  const hash = `#${encodeLink(link)}`
  if (hash !== page.location.hash) page.history.replaceState(page.history.state, '', hash)
}
