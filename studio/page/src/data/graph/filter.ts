// Which edges of a graph are shown.

import { abilityKind } from '../../view/abilities'
import type { GraphEdge, GraphFilter } from '../../view/viewport.types'
import { ABILITIES } from '../abilities'

export const SHOW_ALL: GraphFilter = {
  presence: 'faint',
  colour: 'chance',
  abilities: new Set(ABILITIES),
  minChance: 0,
  maxChance: 1,
  onlyOneWay: false,
  onlyEdited: false,
}

/** Whether an edge passes; the view draws by the same rule. */
export function passes(edge: GraphEdge, filter: GraphFilter): boolean {
  return (
    filter.abilities.has(abilityKind(edge.ability)) &&
    edge.chance >= filter.minChance &&
    edge.chance <= filter.maxChance &&
    (!filter.onlyOneWay || edge.oneWay) &&
    (!filter.onlyEdited || edge.forced || edge.priceFactor !== 1)
  )
}

/** Whether anything is filtered out at all. */
export function isFiltered(filter: GraphFilter): boolean {
  return (
    filter.abilities.size < ABILITIES.length ||
    filter.minChance > 0 ||
    filter.maxChance < 1 ||
    filter.onlyOneWay ||
    filter.onlyEdited
  )
}
