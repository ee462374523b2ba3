import { priceEdge } from '../../data/edit/edits'
import type { Studio } from '../../data/studio'
import { Button } from '../controls'
import { forbid } from '../tools'

/** What "Raise its cost" multiplies a price by. */
const DEARER = 4
const MAX_FACTOR = 1000

/** What can be done about a leg that is an edge of the graph. */
export function LegActions({ studio, edge }: { studio: Studio; edge: { from: number; to: number } }) {
  const { graphs, layers } = studio
  const makeDearer = () => {
    const [from, to] = [graphs.position(edge.from), graphs.position(edge.to)]
    const present = graphs.edge(edge.from, edge.to)?.priceFactor || 1
    if (from === undefined || to === undefined) return
    void layers.apply(priceEdge(from, to, Math.min(MAX_FACTOR / present, DEARER)))
  }
  return (
    <div class="row wrap" role="group" aria-label="Actions for the leg">
      <span data-tour="forbid">
        <Button label="Forbid this leg" icon="forbid" onClick={() => forbid(studio, edge.from, edge.to)} />
      </span>
      <Button label="Raise its cost" icon="plus" hint={`Multiplies its cost by ${DEARER}`} onClick={makeDearer} />
      <Button label="Inspect" icon="look" onClick={() => studio.openTab('graph')} />
    </div>
  )
}
