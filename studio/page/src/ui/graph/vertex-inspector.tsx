import { counted, place } from '../../data/format'
import type { Studio } from '../../data/studio'
import { AbilityName, Button, ChanceBar, Facts, Section } from '../controls'
import { remove } from '../tools'

const STANDINGS = {
  main: 'the main one',
  trap: 'a one-way trap',
  source: 'leads to the main one only',
  apart: 'cut off',
}
const MAX_ROWS = 40

export function VertexInspector({ studio, index }: { studio: Studio; index: number }) {
  const { graphs } = studio
  const at = graphs.position(index)
  const graph = graphs.loaded.value
  if (at === undefined || graph === undefined) return null
  const island = graphs.islands.value.find(({ id }) => id === graph.islands[index])
  const out = graph.edges.filter(({ from }) => from === index)
  const into = graph.edges.filter(({ to }) => to === index)
  return (
    <Section
      title={`Vertex ${index}`}
      actions={<Button label="Deselect" icon="close" bare onClick={() => graphs.select(undefined)} />}
    >
      <Facts
        rows={[
          ['At', place(at)],
          ['Edges', `${out.length} out, ${into.length} in`],
          [
            'Island',
            island === undefined
              ? '-'
              : `${STANDINGS[island.standing]}, ${counted(island.vertices.length, 'vertex', 'vertices')}`,
          ],
        ]}
      />
      <div class="row wrap">
        <Button label="Look there" icon="look" onClick={() => studio.viewport.value?.lookAt(at)} />
        <Button label="Remove vertex" icon="remove" tone="bad" onClick={() => remove(studio, index)} />
      </div>
      <ul class="list" aria-label="Edges that leave">
        {out.slice(0, MAX_ROWS).map((edge) => (
          <li key={edge.to}>
            <button
              type="button"
              class="item"
              onClick={() => graphs.select({ kind: 'edge', from: edge.from, to: edge.to })}
            >
              <strong>to {edge.to}</strong>
              <AbilityName ability={edge.ability} />
              <ChanceBar chance={edge.chance} />
            </button>
          </li>
        ))}
      </ul>
    </Section>
  )
}
