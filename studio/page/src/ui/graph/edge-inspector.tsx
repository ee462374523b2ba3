import { priceEdits } from '../../data/edit/edits'
import { count, counted, duration, factor, percent, place } from '../../data/format'
import type { Studio } from '../../data/studio'
import type { Edge } from '../../gen/surefoot/planner/v1/planner_pb'
import { AbilityName, Button, ChanceBar, Facts, Section } from '../controls'
import { forbid, force } from '../tools'
import { PriceSlider } from './price-slider'
import { ProbeBox } from './probe-box'

const DECISION_SECONDS = 1 / 6

interface Props {
  studio: Studio
  from: number
  to: number
}

export function EdgeInspector({ studio, from, to }: Props) {
  const { graphs } = studio
  const edge = graphs.edge(from, to)
  if (edge === undefined) return null
  return (
    <Section
      title={`Edge ${from} to ${to}`}
      actions={<Button label="Deselect" icon="close" bare onClick={() => graphs.select(undefined)} />}
    >
      <Evidence studio={studio} edge={edge} />
      <BackLink studio={studio} from={from} to={to} />
      <EdgeActions studio={studio} edge={edge} />
      <ProbeBox studio={studio} from={from} to={to} />
    </Section>
  )
}

function Evidence({ studio: { graphs }, edge }: { studio: Studio; edge: Edge }) {
  const { tries, successes, deaths, decisionsMean, decisionsDeviation } = edge
  const mean = `${decisionsMean.toFixed(1)} ± ${decisionsDeviation.toFixed(1)}`
  return (
    <Facts
      rows={[
        ['From', place(graphs.position(edge.from))],
        ['To', place(graphs.position(edge.to))],
        ['Ability', <AbilityName ability={edge.ability} />],
        ['Estimated chance', <ChanceBar chance={edge.chance} label="Estimated chance" />],
        ['Arrived', tries === 0 ? 'never tried' : `${count(successes)} of ${counted(tries, 'try', 'tries')}`],
        ['Died', `${count(deaths)}; chance ${percent(edge.deathChance)}`],
        ['Time', successes === 0 ? '-' : `${duration(decisionsMean * DECISION_SECONDS)} (${mean} decisions)`],
        [
          'Price',
          <>
            {duration(edge.seconds)}
            {edge.priceFactor !== 1 && edge.priceFactor !== 0 && <mark>{factor(edge.priceFactor)}</mark>}
            {edge.forced && <mark>forced</mark>}
          </>,
        ],
      ]}
    />
  )
}

function BackLink({ studio: { graphs }, from, to }: Props) {
  const back = graphs.edge(to, from)
  const isOneWay = graphs.loaded.value?.islands[from] !== graphs.loaded.value?.islands[to]
  if (back === undefined) {
    if (isOneWay) return <p class="warn">One way: no path leads back.</p>
    return <p class="note">No edge back, but another path.</p>
  }
  return (
    <p class="note back">
      The edge back: <ChanceBar chance={back.chance} />
      <Button label={`Show ${to} to ${from}`} onClick={() => graphs.select({ kind: 'edge', from: to, to: from })} />
    </p>
  )
}

function EdgeActions({ studio, edge }: { studio: Studio; edge: Edge }) {
  const { graphs, layers } = studio
  const setPrice = (factor: number) => {
    const [from, to] = [graphs.position(edge.from), graphs.position(edge.to)]
    if (from !== undefined && to !== undefined) {
      void layers.apply(...priceEdits(from, to, edge.priceFactor || 1, factor))
    }
  }
  return (
    <div class="edge-actions" role="group" aria-label="Edit the edge">
      <div class="row wrap">
        <Button label="Forbid" icon="forbid" tone="bad" onClick={() => forbid(studio, edge.from, edge.to)} />
        <Button label="Force" icon="force" disabled={edge.forced} onClick={() => force(studio, edge.from, edge.to)} />
      </div>
      <PriceSlider factor={edge.priceFactor || 1} onSet={setPrice} />
    </div>
  )
}
