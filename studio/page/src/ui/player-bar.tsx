import type { Studio } from '../data/studio'
import { metresBetween } from '../data/world/player'
import { npcNumber } from '../data/world/snapshot'
import { MARK_COLOURS } from '../view/colours'
import { Button } from './controls'

/** The player and the NPCs that chase it, below the map. */
export function PlayerBar({ studio }: { studio: Studio }) {
  const { npcs } = studio
  const chasers = npcs.chasers.value
  const selected = npcs.selectedId.value
  const next =
    selected === undefined || chasers.has(selected) ? 'The nearest NPC that is free' : `NPC ${npcNumber(selected)}`
  return (
    <div class="watch-bar" role="group" aria-label="Player">
      <p class="doing">
        <i class="dot" style={{ background: MARK_COLOURS.player }} />
        <strong>Player</strong>
        <span>{chaseInWords(studio)}</span>
      </p>
      <Button
        label="Chase the player"
        icon="chase"
        hint={`${next} chases the player`}
        onClick={() => studio.chasePlayer()}
      />
      {chasers.size > 0 && (
        <Button label="Stop chasing" icon="stop" onClick={() => void npcs.stopChase([...chasers.keys()])} />
      )}
      <Button label="Remove the player" icon="close" bare onClick={() => studio.setTool('select')} />
    </div>
  )
}

/** "NPC 6 chases it, 4.2 m away", "3 NPCs chase it, the nearest 1.4 m away" */
function chaseInWords({ npcs, live, player }: Studio): string {
  const all = live.npcs.value
  const chasers = [...npcs.chasers.value.keys()].map((id) => all.get(id)).filter((npc) => npc !== undefined)
  const [first] = chasers
  if (first === undefined) return 'No NPC chases it'
  const metres = Math.min(...chasers.map(({ position }) => metresBetween(position, player.at.peek()))).toFixed(1)
  return chasers.length === 1
    ? `NPC ${npcNumber(first.npcId)} chases it, ${metres} m away`
    : `${chasers.length} NPCs chase it, the nearest ${metres} m away`
}
