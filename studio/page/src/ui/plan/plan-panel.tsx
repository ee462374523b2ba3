import { noPathReason } from '../../data/abilities'
import { count, duration, percent, place } from '../../data/format'
import { edgeOf, legEnds } from '../../data/plan/alternatives'
import type { Studio } from '../../data/studio'
import { npcNumber } from '../../data/world/snapshot'
import type { Leg, Plan } from '../../gen/surefoot/planner/v1/planner_pb'
import { AbilityName, Button, ChanceBar, Choice, Empty, Facts, Section } from '../controls'
import { NoGraph } from '../graph/no-graph'
import { LegActions } from './leg-actions'

export function PlanPanel({ studio }: { studio: Studio }) {
  const { plans, graphs } = studio
  if (graphs.id.value === undefined) return <NoGraph studio={studio} />
  return (
    <>
      <Ends studio={studio} />
      {plans.state.value === 'asking' && <p class="note">Looking for a path …</p>}
      {plans.state.value === 'failed' && <Empty title="No plan">{<p>{plans.failure.value}</p>}</Empty>}
      {plans.plans.value.length > 0 && <Result studio={studio} />}
    </>
  )
}

function Ends({ studio }: { studio: Studio }) {
  const { plans, npcs, live } = studio
  const npc = live.npc(npcs.selectedId.value)
  return (
    <Section
      title="From, to"
      actions={
        <>
          <Button label="Swap start and goal" icon="swap" bare onClick={() => plans.swap()} />
          <Button label="Clear the plan" icon="close" bare onClick={() => plans.clear()} />
        </>
      }
    >
      <dl class="ends">
        <dt class="start">Start</dt>
        <dd>{plans.start.value === undefined ? 'not set' : place(plans.start.value)}</dd>
        <dt class="goal">Goal</dt>
        <dd>{plans.goal.value === undefined ? 'not set' : place(plans.goal.value)}</dd>
      </dl>
      <Choice
        label="The next click sets"
        value={plans.next.value}
        options={[
          { value: 'start', name: 'Click sets start' },
          { value: 'goal', name: 'Click sets goal' },
        ]}
        onChange={(next) => {
          studio.setTool('plan')
          plans.next.value = next
        }}
      />
      <Choice
        label="Caution of the path"
        value={plans.caution.value}
        options={[
          { value: 'careful', name: 'Careful' },
          { value: 'bold', name: 'Bold' },
        ]}
        onChange={(caution) => plans.setCaution(caution)}
      />
      <div class="row wrap">
        {studio.tool.value !== 'plan' && (
          <Button label="Pick on the map" icon="plan" tone="main" onClick={() => studio.setTool('plan')} />
        )}
        {npc?.position !== undefined && (
          <Button label="Start at the NPC" icon="spawn" onClick={() => npc.position && plans.setStart(npc.position)} />
        )}
      </div>
    </Section>
  )
}

function Result({ studio }: { studio: Studio }) {
  const { plans } = studio
  const plan = plans.chosen.value
  if (plan === undefined) return null
  if (!plan.found) return <NoWay studio={studio} plan={plan} />
  return (
    <Section title="Path">
      {plans.plans.value.length > 1 && <Ways studio={studio} />}
      <p class="sums">
        <span>
          <strong>{duration(plan.seconds)}</strong> expected
        </span>
        <span>
          <strong>{count(plan.legs.length)}</strong> legs
        </span>
      </p>
      <Facts
        rows={[
          [
            'Arrives',
            <ChanceBar chance={plan.arrivalChance} label="Chance of arriving, with other plans where one fails" />,
          ],
          ['As planned', <ChanceBar chance={plan.asPlannedChance} label="Chance of arriving without another plan" />],
          ['Unrehearsed', <ChanceBar chance={plan.chance} label="Chance that every leg succeeds without rehearsals" />],
          ['Dies, unrehearsed', percent(plan.deathChance)],
        ]}
      />
      <SendButtons studio={studio} />
      <ol class="legs" aria-label="Legs" data-tour="legs">
        {plan.legs.map((leg, index) => (
          <LegRow key={index} studio={studio} plan={plan} leg={leg} index={index} />
        ))}
      </ol>
    </Section>
  )
}

function Ways({ studio: { plans } }: { studio: Studio }) {
  return (
    <div class="ways" role="tablist" aria-label="Alternatives">
      {plans.plans.value.map((plan, index) => (
        <button
          key={index}
          type="button"
          role="tab"
          aria-selected={index === plans.chosenIdx.value}
          onClick={() => plans.choose(index)}
        >
          <strong>{index === 0 ? 'Best' : `Path ${index + 1}`}</strong>
          <span>{duration(plan.seconds)}</span>
          <span>{percent(plan.asPlannedChance)}</span>
        </button>
      ))}
    </div>
  )
}

function LegRow({ studio, plan, leg, index }: { studio: Studio; plan: Plan; leg: Leg; index: number }) {
  const { graphs, plans } = studio
  const selection = graphs.selection.value
  const edge = edgeOf(leg)
  const isSelected = selection?.kind === 'edge' && selection.from === edge?.from && selection.to === edge.to
  const show = () => {
    const { from, to } = legEnds(plan, index, plans.start.value ?? { x: 0, y: 0, z: 0 })
    studio.viewport.value?.lookAt({ x: (from.x + to.x) / 2, y: (from.y + to.y) / 2, z: (from.z + to.z) / 2 })
    graphs.select(edge === undefined ? undefined : { kind: 'edge', ...edge })
  }
  return (
    <li class={isSelected ? 'current' : ''}>
      <button type="button" class="item" aria-pressed={isSelected} onClick={show}>
        <AbilityName ability={leg.ability} />
        <span class="number">{duration(leg.seconds)}</span>
        <ChanceBar chance={leg.chance} />
      </button>
      {leg.ride !== undefined && <p class="note">Rides on {moverName(studio, leg.ride.mover)}.</p>}
      {leg.ride === undefined && leg.needs.length > 0 && (
        <p class="note">
          Needs {leg.needs.map(({ mover }) => moverName(studio, mover)).join(' and ')}: an NPC waits until it is there.
        </p>
      )}
      {edge === undefined && <p class="note">A straight line off the graph: not proved.</p>}
      {isSelected && edge !== undefined && <LegActions studio={studio} edge={edge} />}
    </li>
  )
}

function moverName({ movers }: Studio, index: number): string {
  return movers.list.value[index]?.name ?? `mover ${index}`
}

/** Sends a new NPC from the start to the goal, or the selected NPC from where it is. */
function SendButtons({ studio }: { studio: Studio }) {
  const { plans, npcs, worlds } = studio
  const send = async (chosen: bigint | undefined) => {
    const [start, goal, worldId] = [plans.start.peek(), plans.goal.peek(), worlds.chosenId.peek()]
    if (start === undefined || goal === undefined || worldId === undefined) return
    const id = chosen ?? (await npcs.spawn(worldId, start))
    if (id === undefined) return
    await npcs.send(id, goal)
    studio.setTool('select')
    npcs.goAlong(id)
  }
  const selected = npcs.selectedId.value
  return (
    <div class="row wrap" data-tour="send">
      <Button
        label="Send an NPC"
        icon="spawn"
        tone="main"
        hint="Spawns an NPC at the start"
        onClick={() => void send(undefined)}
      />
      {selected !== undefined && (
        <Button
          label={`Send NPC ${npcNumber(selected)}`}
          icon="send"
          hint="Sends the selected NPC from its position"
          onClick={() => void send(selected)}
        />
      )}
    </div>
  )
}

function NoWay({ studio, plan }: { studio: Studio; plan: Plan }) {
  const nearest = plan.nearestReachable
  return (
    <Section title="No path">
      <p class="warn" role="status">
        {noPathReason(plan.reason)}
      </p>
      {nearest === undefined ? (
        <p class="note">No vertex is reachable from the start.</p>
      ) : (
        <>
          <p class="note">The nearest reachable place is at {place(nearest)}.</p>
          <div class="row wrap">
            <Button label="Look there" icon="look" onClick={() => studio.viewport.value?.lookAt(nearest)} />
            <Button label="Plan to there" icon="plan" tone="main" onClick={() => studio.plans.setGoal(nearest)} />
          </div>
        </>
      )}
      <SendButtons studio={studio} />
    </Section>
  )
}
