// What a message about a graph means for the graph that is shown.

import type { GetGraphResponse, GraphSummary } from '../../gen/surefoot/planner/v1/planner_pb'

export type News = 'none' | 'other graph' | 'other figures'

/** Compares a message with what was loaded: other edges through layers or a build that goes on, or only what NPCs reported. */
export function newsOf(
  loaded: Pick<GetGraphResponse, 'summary' | 'revision'> | undefined,
  summary: GraphSummary | undefined,
  revision: bigint,
): News {
  const known = loaded?.summary
  const isBuilt = summary?.probes !== known?.probes || summary?.expectedEdges !== known?.expectedEdges
  if (revision !== loaded?.revision || isBuilt) return 'other graph'
  return summary?.traversals === known?.traversals ? 'none' : 'other figures'
}
