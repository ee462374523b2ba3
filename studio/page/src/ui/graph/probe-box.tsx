import { probeInWords, tally } from '../../data/graph/probes'
import { counted } from '../../data/format'
import type { Studio } from '../../data/studio'
import { Button } from '../controls'

/** Tries an edge again, as often as wanted, and shows each attempt in the view. */
export function ProbeBox({ studio, from, to }: { studio: Studio; from: number; to: number }) {
  const { probes, graphs } = studio
  const graphId = graphs.id.value
  if (graphId === undefined) return null
  const edge = { graphId, from, to }
  const { tries, successes, uncounted } = tally(probes.made.value, edge)
  const last = probes.last(edge)
  return (
    <div class="probe" role="group" aria-label="Probe the edge">
      <div class="row wrap">
        <Button
          label={probes.running.value ? 'Probing …' : 'Probe again'}
          icon="play"
          tone="main"
          disabled={probes.running.value}
          onClick={() => void probes.probe(edge)}
        />
        {last !== undefined && (
          <Button
            label="Replay"
            icon="redo"
            disabled={probes.playing.value}
            onClick={() => probes.replay(last.result)}
          />
        )}
        {uncounted > 0 && (
          <Button
            label={uncounted === 1 ? 'Count it' : `Count ${uncounted}`}
            icon="check"
            hint="Adds these probes to the evidence"
            onClick={() => void probes.count(edge)}
          />
        )}
      </div>
      <p role="status" class={last?.result.reached === false ? 'warn' : 'note'}>
        {last === undefined ? 'Not probed here yet.' : `${probeInWords(last.result)}.`}
        {tries > 1 && ` ${successes} of ${counted(tries, 'probe')} made here arrived.`}
      </p>
    </div>
  )
}
