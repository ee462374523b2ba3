import { useSignal } from '@preact/signals'
import { STATE_NAMES } from '../../data/abilities'
import { counted } from '../../data/format'
import type { Studio } from '../../data/studio'
import { findNpcs, npcNumber, stateOf } from '../../data/world/snapshot'
import { STATE_COLOURS } from '../../view/colours'
import { Button, Empty, Section } from '../controls'
import { SelectedNpcCard } from './selected-npc'

/** Rows that the list has at most: a crowd is found by searching. */
const MAX_ROWS = 150

export function NpcsPanel({ studio }: { studio: Studio }) {
  return (
    <>
      {studio.npcs.selectedId.value !== undefined && <SelectedNpcCard studio={studio} />}
      <NpcList studio={studio} />
    </>
  )
}

function NpcList({ studio }: { studio: Studio }) {
  const search = useSignal('')
  const { live, npcs, worlds } = studio
  if (worlds.chosen.value === undefined) return <Empty title="No world yet" />
  const found = findNpcs(live.npcs.value, search.value)
  return (
    <Section
      title={counted(live.npcs.value.size, 'NPC')}
      actions={
        <>
          <Button
            label="Spawn"
            icon="plus"
            hint="Then click the ground (8)"
            pressed={studio.tool.value === 'spawn'}
            onClick={() => studio.setTool('spawn')}
          />
          <Button
            label="Player"
            icon="player"
            hint="Walk among the NPCs as a player (9)"
            pressed={studio.tool.value === 'player'}
            onClick={() => studio.setTool('player')}
          />
        </>
      }
    >
      <input
        type="search"
        aria-label="Search NPCs"
        placeholder="Number or state"
        value={search.value}
        onInput={(event) => (search.value = event.currentTarget.value)}
      />
      {found.length === 0 && (
        <Empty title={live.npcs.value.size === 0 ? 'No NPCs on this map' : 'No NPC matches'}>
          {live.npcs.value.size === 0 && <p>Spawn an NPC: press 8 and click the ground.</p>}
        </Empty>
      )}
      <ul class="list npcs" aria-label="NPCs">
        {found.slice(0, MAX_ROWS).map((npc) => (
          <li key={npc.npcId} class={npc.npcId === npcs.selectedId.value ? 'chosen' : ''}>
            <button
              type="button"
              class="item"
              aria-pressed={npc.npcId === npcs.selectedId.value}
              onClick={() => {
                npcs.select(npc.npcId)
                if (npc.position !== undefined) studio.viewport.value?.lookAt(npc.position)
              }}
            >
              <i class="dot" style={{ background: STATE_COLOURS[stateOf(npc)] }} />
              <strong>NPC {npcNumber(npc.npcId)}</strong>
              <span>{STATE_NAMES[stateOf(npc)]}</span>
              {npc.workerId === 0n && <span class="warn">no worker</span>}
            </button>
          </li>
        ))}
      </ul>
      {found.length > MAX_ROWS && <p class="note">And {counted(found.length - MAX_ROWS, 'more', 'more')}.</p>}
    </Section>
  )
}
