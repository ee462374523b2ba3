import { count } from '../../data/format'
import { stageName } from '../../data/build/builds'
import { blockedInWords } from '../../data/net/policy'
import type { Studio } from '../../data/studio'
import { Empty, Progress } from '../controls'

/** Says why there is no graph in a sentence. */
export function noGraphInWords({ graphs, context }: Studio): string {
  if (context.planner.link.state.value === 'lost') return 'The planner does not answer.'
  const state = graphs.state.value
  if (state.kind === 'building') return 'There is no graph yet: it is being built.'
  return state.kind === 'failed' ? `There is no graph: ${state.why}` : 'There is no graph yet.'
}

/** Says why there is no graph, and what helps. */
export function NoGraph({ studio: { graphs, worlds, context } }: { studio: Studio }) {
  const state = graphs.state.value
  if (worlds.chosen.value === undefined) return <Empty title="No world yet" />
  const { link, session } = context.planner
  if (link.blocked.value) {
    return (
      <Empty title="This page cannot call the planner">
        <p>{blockedInWords('planner', session.origin)}</p>
      </Empty>
    )
  }
  if (link.state.value === 'lost') {
    return (
      <Empty title="The planner does not answer">
        <p>
          Graphs and plans come from a planner. This page looks for it at <code>{context.planner.address}</code>.
        </p>
        <p>
          Start one with <code>surefoot plan</code>, or everything with <code>surefoot up</code>. The page connects as
          soon as it answers. You can watch NPCs without a planner.
        </p>
      </Empty>
    )
  }
  switch (state.kind) {
    case 'building': {
      const { stage, probesDone, probesTotal } = state.progress
      const isCounted = probesTotal > 0n
      return (
        <Empty title="The graph is being built">
          <Progress label="Build" share={isCounted ? Number(probesDone) / Number(probesTotal) : undefined} />
          <p>
            {stageName(stage)}
            {isCounted ? `: ${count(probesDone)} of ${count(probesTotal)} probes` : ' …'}
          </p>
        </Empty>
      )
    }
    case 'failed':
      return (
        <Empty title="There is no graph">
          <p>{state.why}</p>
          <p>Trying again …</p>
        </Empty>
      )
    default:
      return <Empty title="Looking for the graph …" />
  }
}
