import { counted, place } from '../../data/format'
import type { Island } from '../../data/graph/islands'
import type { Studio } from '../../data/studio'
import { Section } from '../controls'

const MAX_ROWS = 50

/** Islands that the main one leads to, and that do not lead back. */
export function TrapsSection({ studio }: { studio: Studio }) {
  const { graphs } = studio
  const traps = graphs.traps.value
  const others = graphs.islands.value.filter(({ standing }) => standing === 'source' || standing === 'apart')
  return (
    <Section title="One-way traps">
      {traps.length === 0 && <p class="note">None: NPCs that leave the main island can return to it.</p>}
      <ul class="list" aria-label="Traps">
        {traps.slice(0, MAX_ROWS).map((trap) => (
          <TrapRow key={trap.id} studio={studio} trap={trap} />
        ))}
      </ul>
      {traps.length > MAX_ROWS && <p class="note">And {traps.length - MAX_ROWS} more.</p>}
      {others.length > 0 && (
        <p class="note">
          {counted(others.length, 'more island')} cannot be reached from the main one at all (
          {counted(
            others.reduce((sum, { vertices }) => sum + vertices.length, 0),
            'vertex',
            'vertices',
          )}
          ).
        </p>
      )}
    </Section>
  )
}

function TrapRow({ studio, trap }: { studio: Studio; trap: Island }) {
  const { graphs } = studio
  const entrance = trap.entrances[0]
  const at = graphs.position(entrance?.to ?? trap.vertices[0] ?? 0)
  const look = () => {
    if (at !== undefined) studio.viewport.value?.lookAt(at)
    if (entrance !== undefined) graphs.select({ kind: 'edge', from: entrance.from, to: entrance.to })
  }
  return (
    <li>
      <button type="button" class="item" onClick={look}>
        <strong>{place(at)}</strong>
        <span>
          {counted(trap.vertices.length, 'vertex', 'vertices')}, {counted(trap.entrances.length, 'way', 'ways')} in
        </span>
      </button>
    </li>
  )
}
