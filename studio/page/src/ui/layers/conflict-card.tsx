import { describe } from '../../data/edit/edits'
import { changeInWords } from '../../data/edit/difference'
import type { Conflict } from '../../data/edit/layers'
import type { Studio } from '../../data/studio'
import { Button } from '../controls'

const MAX_ROWS = 8

/** Edits that were held back, and what other clients changed in the meantime. */
export function ConflictCard({ studio: { layers }, conflict }: { studio: Studio; conflict: Conflict }) {
  return (
    <section class="conflict" role="alert" aria-label="Not applied">
      <h2>Not applied</h2>
      <p>{conflict.why}</p>
      <h3>Yours</h3>
      <ul>
        {conflict.held
          .flatMap(({ layer, edits }) => edits.map((edit) => ({ layer, edit })))
          .map(({ layer, edit }, index) => (
            <li key={index}>
              {describe(edit)} <span class="note">in {layer}</span>
            </li>
          ))}
      </ul>
      {conflict.changes.length > 0 && <h3>Theirs</h3>}
      {conflict.changes.map((change) => (
        <div key={change.layer}>
          <p>{changeInWords(change)}</p>
          <ul>
            {[
              ...change.added.map((edit) => ({ sign: '+', edit })),
              ...change.removed.map((edit) => ({ sign: '-', edit })),
            ]
              .slice(0, MAX_ROWS)
              .map(({ sign, edit }, index) => (
                <li key={index}>
                  {sign} {describe(edit)}
                </li>
              ))}
          </ul>
        </div>
      ))}
      <div class="row">
        <Button
          label={conflict.changes.length > 0 ? 'Apply on top' : 'Apply again'}
          tone="main"
          onClick={() => void layers.applyOnTop()}
        />
        <Button label="Discard" onClick={() => layers.discardConflict()} />
      </div>
    </section>
  )
}
