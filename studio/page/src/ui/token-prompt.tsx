import { useState } from 'preact/hooks'
import type { Context } from '../data/context'
import { proposedSessions, type Session } from '../data/net/session'
import { Button, Check } from './controls'
import { Dialog } from './dialog'

/** Asks for the token that calls to an origin are made with. It stays in this tab. */
export function TokenPrompt({ context: { world, planner } }: { context: Context }) {
  const asking = [world.session, planner.session].find(({ wanted }) => wanted.value !== undefined)
  if (asking === undefined) return null
  const later = () => {
    for (const { session } of [world, planner]) session.dismiss()
  }
  return (
    <Dialog title="Token" key={asking.origin} onClose={later}>
      <TokenForm context={{ world, planner }} asking={asking} onLater={later} />
    </Dialog>
  )
}

interface FormProps {
  context: Pick<Context, 'world' | 'planner'>
  asking: Session
  onLater: () => void
}

function TokenForm({ context: { world, planner }, asking, onLater }: FormProps) {
  // What is kept for one service is not put before the user where it could go to a foreign one.
  const [token, setToken] = useState(world.isForeign || planner.isForeign ? '' : asking.token.peek())
  const [chosen, setChosen] = useState(() => proposedSessions(asking, [world, planner]))
  const choose = (session: Session, isChosen: boolean) => {
    const others = [...chosen].filter((other) => other !== session)
    setChosen(new Set(isChosen ? [...others, session] : others))
  }
  return (
    <form
      onSubmit={(event) => {
        event.preventDefault()
        asking.dismiss()
        for (const session of chosen) session.give(token)
      }}
    >
      <p class="origin">{asking.wanted.value}</p>
      <div class="field">
        <label for="token">Secret of the token</label>
        <input
          id="token"
          type="password"
          autocomplete="off"
          autofocus
          spellcheck={false}
          value={token}
          onInput={(event) => setToken(event.currentTarget.value)}
        />
      </div>
      {world.session !== planner.session && (
        <div class="targets" role="group" aria-label="Send it to">
          <Check
            label={`Send it to the world server ${world.session.origin}`}
            checked={chosen.has(world.session)}
            onChange={(isChosen) => choose(world.session, isChosen)}
          />
          <Check
            label={`Send it to the planner ${planner.session.origin}`}
            checked={chosen.has(planner.session)}
            onChange={(isChosen) => choose(planner.session, isChosen)}
          />
        </div>
      )}
      <p class="note">It is kept in this tab until you close it, for these addresses only.</p>
      <div class="row end">
        <Button label="Later" onClick={onLater} />
        <button type="submit" class="button main" disabled={chosen.size === 0}>
          Use it
        </button>
      </div>
    </form>
  )
}
