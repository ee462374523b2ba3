import { useState } from 'preact/hooks'
import { graphLabel, pickGraph, relativeOf } from '../../data/build/graph-list'
import { count, percent, place } from '../../data/format'
import type { Studio } from '../../data/studio'
import type { Place } from '../../view/viewport.types'
import { Button, Empty, Facts, Section, SelectField } from '../controls'

const MAX_ROWS = 40

/** What became reachable or unreachable between two graphs, of one map or of two versions of it. */
export function CompareSection({ studio }: { studio: Studio }) {
  const { builds, graphs } = studio
  const [chosenBefore, setBefore] = useState('')
  const [chosenAfter, setAfter] = useState('')
  const list = graphs.list.value
  const options = list.map((graph) => ({ value: graph.graphId, name: graphLabel(graph) }))
  const after = pickGraph(list, [chosenAfter, graphs.id.value])
  const before = pickGraph(list, [chosenBefore, relativeOf(list, after)])
  if (options.length < 2) {
    return (
      <Section title="Compare">
        <Empty title="Comparing needs two graphs">
          <p>Build another graph, with other settings or for another version of the map.</p>
        </Empty>
      </Section>
    )
  }
  return (
    <Section title="Compare">
      <SelectField label="Before" value={before} options={options} onChange={setBefore} />
      <SelectField label="After" value={after} options={options} onChange={setAfter} />
      <div class="row wrap">
        <Button
          label={builds.comparing.value ? 'Comparing …' : 'Compare'}
          tone="main"
          disabled={builds.comparing.value || before === after}
          onClick={() => void builds.compare(before, after)}
        />
        <ShowButton studio={studio} graphId={after} />
        {builds.comparison.value && <Button label="Clear" onClick={() => builds.clearComparison()} />}
      </div>
      <Outcome studio={studio} />
    </Section>
  )
}

function ShowButton({ studio: { graphs, site }, graphId }: { studio: Studio; graphId: string }) {
  const mapHash = graphs.list.value.find((graph) => graph.graphId === graphId)?.summary?.mapHash
  const isHere = mapHash !== undefined && mapHash === site.value?.mapHash
  return (
    <Button
      label="Show the one after"
      disabled={!isHere || graphs.id.value === graphId}
      hint={isHere ? undefined : 'It belongs to another map'}
      onClick={() => mapHash !== undefined && graphs.show(mapHash, graphId)}
    />
  )
}

function Outcome({ studio }: { studio: Studio }) {
  const result = studio.builds.comparison.value?.result
  if (result === undefined) return null
  const arrow = (before: string, after: string) => `${before} → ${after}`
  return (
    <>
      <Facts
        rows={[
          ['Pairs connected', arrow(percent(result.connectedBefore), percent(result.connectedAfter))],
          ['Islands', arrow(count(result.islandsBefore), count(result.islandsAfter))],
          ['Places lost', count(result.lost.length)],
          ['Places gained', count(result.gained.length)],
        ]}
      />
      <Places studio={studio} title="Became unreachable" places={result.lost} />
      <Places studio={studio} title="Became reachable" places={result.gained} />
    </>
  )
}

function Places({ studio, title, places }: { studio: Studio; title: string; places: readonly Place[] }) {
  if (places.length === 0) return null
  return (
    <>
      <h3>{title}</h3>
      <ul class="chips places" aria-label={title}>
        {places.slice(0, MAX_ROWS).map((at, index) => (
          <li key={index}>
            <button type="button" onClick={() => studio.viewport.value?.lookAt(at)}>
              {place(at)}
            </button>
          </li>
        ))}
      </ul>
      {places.length > MAX_ROWS && <p class="note">And {count(places.length - MAX_ROWS)} more.</p>}
    </>
  )
}
