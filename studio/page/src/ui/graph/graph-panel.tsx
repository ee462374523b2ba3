import { useComputed } from '@preact/signals'
import { graphLabel } from '../../data/build/graph-list'
import { count, duration, percent } from '../../data/format'
import { passes } from '../../data/graph/filter'
import type { Studio } from '../../data/studio'
import { Facts, Section, SelectField } from '../controls'
import { EdgeInspector } from './edge-inspector'
import { FilterSection } from './filter-section'
import { NoGraph } from './no-graph'
import { TrapsSection } from './traps-section'
import { VertexInspector } from './vertex-inspector'

export function GraphPanel({ studio }: { studio: Studio }) {
  const { graphs } = studio
  if (graphs.id.value === undefined) return <NoGraph studio={studio} />
  const selection = graphs.selection.value
  return (
    <>
      {selection?.kind === 'edge' && (
        <EdgeInspector
          key={`${selection.from}>${selection.to}`}
          studio={studio}
          from={selection.from}
          to={selection.to}
        />
      )}
      {selection?.kind === 'vertex' && <VertexInspector studio={studio} index={selection.index} />}
      <Summary studio={studio} />
      <FilterSection studio={studio} />
      <TrapsSection studio={studio} />
    </>
  )
}

function Summary({ studio }: { studio: Studio }) {
  const { graphs } = studio
  const shown = useComputed(() => {
    const filter = graphs.filter.value
    return (graphs.shown.value?.edges ?? []).filter((edge) => passes(edge, filter)).length
  })
  const summary = graphs.summary.value
  const edges = graphs.loaded.value?.edges.length ?? 0
  if (summary === undefined) return null
  return (
    <Section title="Graph">
      <GraphPicker studio={studio} />
      <Facts
        rows={[
          ['Vertices', count(summary.vertices)],
          ['Edges', shown.value === edges ? count(edges) : `${count(shown.value)} shown of ${count(edges)}`],
          ...(summary.expectedEdges > 0
            ? [['Being built', `${count(summary.expectedEdges)} edges are expected, not proved yet`] as const]
            : []),
          ['Islands', count(summary.islands)],
          ['Pairs connected', percent(summary.connected)],
          [
            'Probes',
            summary.expectedEdges > 0
              ? `${count(summary.probes)} so far`
              : `${count(summary.probes)} for ${count(summary.candidates)} candidates`,
          ],
          ['Build', `${duration(summary.buildS)}${summary.cached ? ', from the cache' : ''}`],
          ['Traversals by NPCs', count(summary.traversals)],
          [
            'Edits',
            summary.unappliedEdits > 0
              ? `${summary.edits}, ${summary.unappliedEdits} not applied`
              : count(summary.edits),
          ],
        ]}
      />
    </Section>
  )
}

/** Chooses among the graphs of this map, where there are several. */
function GraphPicker({ studio: { graphs, site } }: { studio: Studio }) {
  const mapHash = site.value?.mapHash
  const here = graphs.list.value.filter(({ summary }) => summary?.mapHash === mapHash)
  if (mapHash === undefined || here.length < 2) return null
  const options = here.map((graph) => ({ value: graph.graphId, name: graphLabel(graph) }))
  return (
    <SelectField
      label="Shown"
      value={graphs.id.value ?? ''}
      options={options}
      onChange={(graphId) => graphs.show(mapHash, graphId)}
    />
  )
}
