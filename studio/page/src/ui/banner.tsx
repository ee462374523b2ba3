import type { Studio } from '../data/studio'
import { Icon } from './icons'

/** Says which service is gone. What was seen last stays on the screen. */
export function Banner({ studio: { context } }: { studio: Studio }) {
  const lines = [
    context.world.link.state.value === 'lost' ? 'The world server is gone; trying again …' : '',
    context.planner.link.state.value === 'lost' ? 'No planner answers; trying again …' : '',
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
