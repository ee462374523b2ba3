import { outcomeName, STATE_NAMES } from '../../data/abilities'
import { count, duration, place } from '../../data/format'
import type { Studio } from '../../data/studio'
import type { Followed } from '../../data/world/npcs'
import { npcNumber, stateOf } from '../../data/world/snapshot'
import { Outcome } from '../../gen/surefoot/world/v1/world_pb'
import { STATE_COLOURS } from '../../view/colours'
import { AbilityName, Button, ChanceBar, Facts, Section, SureButton } from '../controls'

export function SelectedNpcCard({ studio }: { studio: Studio }) {
  const { npcs, live } = studio
  const id = npcs.selectedId.value
  if (id === undefined) return null
  const followed = npcs.followed.value?.id === id ? npcs.followed.value : undefined
  const npc = live.npcs.value.get(id) ?? followed?.npc
  const state = npc === undefined ? undefined : stateOf(npc)
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
            ['Goal', place(npc.goal)],
            ['Worker', npc.workerId === 0n ? <span class="warn">none</span> : String(npc.workerId)],
            ['Attempts', `${count(npc.attemptsBegun)} begun, ${count(npc.attemptsEnded)} ended`],
          ]}
        />
      )}
      <Actions studio={studio} id={id} />
      {followed !== undefined && <NpcPlan followed={followed} studio={studio} />}
      {followed !== undefined && <History followed={followed} />}
    </Section>
  )
}

function Actions({ studio, id }: { studio: Studio; id: bigint }) {
  const { npcs, live, plans } = studio
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
      <Button label="Plan from here" icon="plan" onClick={planFromHere} />
      <SureButton label="Remove" question="Remove this NPC?" icon="trash" onSure={() => void npcs.remove(id)} />
    </div>
  )
}

function NpcPlan({ followed, studio }: { followed: Followed; studio: Studio }) {
  const { plan, waypointIdx } = followed
  if (plan === undefined || plan.waypoints.length === 0) {
    return <p class="note">This NPC has no plan.</p>
  }
  return (
    <>
      <h3>Plan</h3>
      {plan.noPath !== '' && <p class="warn">No path: {plan.noPath}. It goes as near as it can.</p>}
      <ol class="legs" aria-label="Legs of its plan">
        {plan.legs.map((leg, index) => (
          <li
            key={index}
            class={index < waypointIdx ? 'past' : index === waypointIdx ? 'current' : ''}
            aria-current={index === waypointIdx ? 'step' : undefined}
          >
            <button
              type="button"
              class="item"
              onClick={() => {
                const at = plan.waypoints[index]
                if (at !== undefined) studio.viewport.value?.lookAt(at)
              }}
            >
              <AbilityName ability={leg.ability} />
              <span class="number">{duration(leg.seconds)}</span>
              <ChanceBar chance={leg.chance} />
            </button>
          </li>
        ))}
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
        {[...history].reverse().map(({ attempt, outcome, seconds, goal }) => (
          <li
            key={attempt}
            class={outcome === Outcome.REACHED ? 'good' : 'bad'}
            title={`Attempt ${attempt}, to ${place(goal)}`}
          >
            {outcomeName(outcome)} <span class="number">{duration(seconds)}</span>
          </li>
        ))}
      </ul>
    </>
  )
}
