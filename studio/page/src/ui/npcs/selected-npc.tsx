import { outcomeName, routeName, standingReason, STATE_NAMES } from '../../data/abilities'
import { count, duration, place } from '../../data/format'
import type { Studio } from '../../data/studio'
import type { Followed } from '../../data/world/npcs'
import { metresBetween } from '../../data/world/player'
import { npcNumber, stateOf } from '../../data/world/snapshot'
import { Outcome } from '../../gen/surefoot/world/v1/world_pb'
import { STATE_COLOURS } from '../../view/colours'
import { AbilityName, Button, ChanceBar, Facts, Section, SureButton } from '../controls'
import { LegActions } from '../plan/leg-actions'

export function SelectedNpcCard({ studio }: { studio: Studio }) {
  const { npcs, live, player } = studio
  const id = npcs.selectedId.value
  if (id === undefined) return null
  const followed = npcs.followed.value?.id === id ? npcs.followed.value : undefined
  const npc = live.npcs.value.get(id) ?? followed?.npc
  const state = npc === undefined ? undefined : stateOf(npc)
  const reason = npc === undefined ? '' : standingReason(npc.standing)
  return (
    <Section
      title={`NPC ${npcNumber(id)}`}
      actions={<Button label="Deselect" icon="close" bare onClick={() => npcs.select(undefined)} />}
    >
      {npc !== undefined && state !== undefined && (
        <Facts
          rows={[
            [
              'State',
              <span class="state">
                <i class="dot" style={{ background: STATE_COLOURS[state] }} />
                {STATE_NAMES[state]}
              </span>,
            ],
            ['At', place(npc.position)],
            npcs.chasers.value.has(id)
              ? ['Chases', `the player, ${metresBetween(npc.position, player.at.peek()).toFixed(1)} m away`]
              : ['Goal', place(npc.goal)],
            ['Route', routeName(npc.route, npc.routeStop) || 'none'],
            ['Worker', npc.workerId === 0n ? <span class="warn">none</span> : String(npc.workerId)],
            ['Attempts', `${count(npc.attemptsBegun)} begun, ${count(npc.attemptsEnded)} ended`],
          ]}
        />
      )}
      {reason !== '' && (
        <p class="note" role="status">
          It stands: {reason}
        </p>
      )}
      <Actions studio={studio} id={id} />
      {followed !== undefined && <NpcPlan followed={followed} studio={studio} />}
      {followed !== undefined && <History followed={followed} />}
    </Section>
  )
}

function Actions({ studio, id }: { studio: Studio; id: bigint }) {
  const { npcs, live, plans, player } = studio
  const planFromHere = () => {
    const at = live.moment.peek().npcs.get(id)?.position
    if (at === undefined) return
    studio.setTool('plan')
    plans.setStart(at)
  }
  const tool = studio.tool.value
  return (
    <div class="row wrap" role="group" aria-label="Actions for the NPC">
      <Button label="Send somewhere" icon="send" pressed={tool === 'send'} onClick={() => studio.setTool('send')} />
      <Button
        label="Teleport"
        icon="teleport"
        pressed={tool === 'teleport'}
        onClick={() => studio.setTool('teleport')}
      />
      {player.isThere.value && <ChaseButton studio={studio} id={id} />}
      <Button label="Plan from here" icon="plan" onClick={planFromHere} />
      <SureButton label="Remove" question="Remove this NPC?" icon="trash" onSure={() => void npcs.remove(id)} />
    </div>
  )
}

function ChaseButton({ studio, id }: { studio: Studio; id: bigint }) {
  return studio.npcs.chasers.value.has(id) ? (
    <Button label="Stop chasing" icon="stop" onClick={() => void studio.npcs.stopChase([id])} />
  ) : (
    <Button label="Chase the player" icon="chase" onClick={() => studio.chasePlayer(id)} />
  )
}

function NpcPlan({ followed, studio }: { followed: Followed; studio: Studio }) {
  const { plan, waypointIdx } = followed
  const { graphs, npcs } = studio
  // Of the legs that it has behind it, only the last.
  const first = Math.max(0, waypointIdx - 1)
  const selection = graphs.selection.value
  const selected = selection?.kind === 'edge' ? graphs.edge(selection.from, selection.to) : undefined
  if (plan === undefined || plan.waypoints.length === 0) {
    return <p class="note">This NPC has no plan.</p>
  }
  return (
    <>
      <h3>Plan</h3>
      {plan.noPath !== '' && <p class="warn">No path: {plan.noPath}. It goes as near as it can.</p>}
      <ol class="legs" aria-label="Legs of its plan" style={{ counterReset: `leg ${first}` }}>
        {plan.legs.slice(first).map((leg, row) => {
          const index = first + row
          const [from, to] = [plan.waypoints[index - 1], plan.waypoints[index]]
          const isSelected = selected !== undefined && graphs.isBetween(selected, from, to)
          return (
            <li
              key={index}
              class={index < waypointIdx ? 'past' : index === waypointIdx ? 'current' : ''}
              aria-current={index === waypointIdx ? 'step' : undefined}
            >
              <button
                type="button"
                class="item"
                aria-pressed={isSelected}
                onClick={() => {
                  const edge = graphs.edgeBetween(from, to)
                  graphs.select(edge && !isSelected ? { kind: 'edge', from: edge.from, to: edge.to } : undefined)
                  if (to !== undefined && !npcs.camera.value) studio.viewport.value?.lookAt(to)
                }}
              >
                <AbilityName ability={leg.ability} />
                <span class="number">{duration(leg.seconds)}</span>
                <ChanceBar chance={leg.chance} />
              </button>
              {isSelected && <LegActions studio={studio} edge={selected} />}
            </li>
          )
        })}
      </ol>
    </>
  )
}

function History({ followed: { history } }: { followed: Followed }) {
  return (
    <>
      <h3>Attempts so far</h3>
      {history.length === 0 && <p class="note">No attempt has ended yet.</p>}
      <ul class="chips" aria-label="Outcomes, the latest first">
        {[...history].reverse().map(({ attempt, outcome, seconds, goal, noPath }) => (
          <li
            key={attempt}
            class={outcome === Outcome.REACHED ? 'good' : 'bad'}
            title={`Attempt ${attempt}, to ${place(goal)}${noPath && `: ${noPath}`}`}
          >
            {outcomeName(outcome)} <span class="number">{duration(seconds)}</span>
          </li>
        ))}
      </ul>
    </>
  )
}
