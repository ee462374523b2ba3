import { blockedInWords } from '../data/net/policy'
import type { PlannerSide, WorldSide } from '../data/net/services'
import type { Studio } from '../data/studio'
import { Icon } from './icons'

/** Says which service is gone or may not be called. What was seen last stays on the screen. */
export function Banner({ studio: { context } }: { studio: Studio }) {
  const lines = [
    lineFor('world server', context.world, 'The world server does not answer; trying again …'),
    lineFor('planner', context.planner, 'The planner does not answer; trying again …'),
  ].filter((line) => line !== '')
  return (
    <div class="banners" role="status" aria-live="polite">
      {lines.map((line) => (
        <p class="banner" key={line}>
          <Icon name="warn" size={16} />
          {line}
        </p>
      ))}
    </div>
  )
}

function lineFor(name: string, { link, session }: WorldSide | PlannerSide, gone: string): string {
  if (link.blocked.value) return blockedInWords(name, session.origin)
  return link.state.value === 'lost' ? gone : ''
}
