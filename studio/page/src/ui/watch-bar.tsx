import { abilityName } from '../data/abilities'
import { percent } from '../data/format'
import type { Studio } from '../data/studio'
import { npcNumber, stateOf } from '../data/world/snapshot'
import { STATE_NAMES } from '../data/abilities'
import { STATE_COLOURS } from '../view/colours'
import { AbilityName, Button } from './controls'
import { PlotsButton, PlotsHint } from './motion/plots-button'
import { PlayerBar } from './player-bar'
import { ReachBar } from './reach-bar'
import { ReplayBar } from './replay-bar'

/** What the watched NPC is doing, below the map; in its place, the player, the area tool or the replay of an attempt. */
export function WatchBar({ studio }: { studio: Studio }) {
  const { npcs, live, player, replays, view } = studio
  if (player.isThere.value) return <PlayerBar studio={studio} />
  if (studio.tool.value === 'reach') return <ReachBar studio={studio} />
  if (replays.shown.value !== undefined) return <ReplayBar studio={studio} />
  if (live.npcs.value.size === 0) return null
  const selected = npcs.selectedId.value
  const hasPlots = view.plots.value
  return (
    <div class={`watch-bar ${hasPlots ? 'with-hint' : ''}`} role="group" aria-label="Watch NPCs">
      {hasPlots && <PlotsHint isSelected={selected !== undefined} />}
      {selected !== undefined && <Doing studio={studio} id={selected} />}
      {selected !== undefined && (
        <Button
          label={npcs.camera.value ? 'Following' : 'Follow'}
          icon="follow"
          hint="The camera follows the NPC (F)"
          pressed={npcs.camera.value}
          onClick={() => npcs.toggleCamera()}
        />
      )}
      <span data-tour="another">
        <Button
          label={selected === undefined ? 'Follow an NPC' : 'Another'}
          icon="next"
          hint="Follow another NPC (J)"
          onClick={() => studio.followAnother()}
        />
      </span>
      {selected !== undefined && (
        <Button label="Replay" icon="replay" hint="Replay its last attempt (R)" onClick={() => studio.toggleReplay()} />
      )}
      {(selected !== undefined || hasPlots) && <PlotsButton studio={studio} />}
    </div>
  )
}

/** "NPC 6 is on leg 3 of 9: Double jump, 99 %" */
function Doing({ studio: { npcs, live }, id }: { studio: Studio; id: bigint }) {
  const npc = live.npcs.value.get(id)
  if (npc === undefined) return null
  const state = stateOf(npc)
  const followed = npcs.followed.value?.id === id ? npcs.followed.value : undefined
  const legs = followed?.plan?.legs ?? []
  const leg = state === 'seeking' ? legs[followed?.waypointIdx ?? 0] : undefined
  return (
    <p class="doing">
      <i class="dot" style={{ background: STATE_COLOURS[state] }} />
      <strong>NPC {npcNumber(id)}</strong>
      {leg === undefined ? (
        <span>{state === 'seeking' ? 'is heading straight for its goal' : STATE_NAMES[state]}</span>
      ) : (
        <>
          <span>
            leg {(followed?.waypointIdx ?? 0) + 1} of {legs.length}
          </span>
          <span title={`${abilityName(leg.ability)} with a chance of ${percent(leg.chance)}`}>
            <AbilityName ability={leg.ability} />
          </span>
        </>
      )}
    </p>
  )
}
