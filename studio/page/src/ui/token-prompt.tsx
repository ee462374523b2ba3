import { useState } from 'preact/hooks'
import type { Session } from '../data/net/session'
import { Button } from './controls'
import { Dialog } from './dialog'

/** Asks for the token that calls are made with. It stays in this tab. */
export function TokenPrompt({ session }: { session: Session }) {
  const why = session.wanted.value
  return why === undefined ? null : <Prompt session={session} why={why} />
}

function Prompt({ session, why }: { session: Session; why: string }) {
  const [token, setToken] = useState(session.token.value)
  return (
    <Dialog title="Token" onClose={() => session.dismiss()}>
      <form
        onSubmit={(event) => {
          event.preventDefault()
          session.give(token)
        }}
      >
        <p>{why}</p>
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
        <p class="note">It is kept in this tab until you close it.</p>
        <div class="row end">
          <Button label="Later" onClick={() => session.dismiss()} />
          <button type="submit" class="button main">
            Use it
          </button>
        </div>
      </form>
    </Dialog>
  )
}
