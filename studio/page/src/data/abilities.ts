// Names and order of abilities, outcomes and what else the contracts number.

import { NoPath, Placement } from '../gen/surefoot/planner/v1/planner_pb'
import type { Ability } from '../gen/surefoot/world/v1/map_pb'
import { RouteKind } from '../gen/surefoot/world/v1/route_pb'
import { Outcome, Standing } from '../gen/surefoot/world/v1/world_pb'
import { LOOKS, lookOf } from '../view/abilities'
import type { NpcState } from '../view/viewport.types'

/** All abilities, the least demanding first. */
export const ABILITIES: readonly Ability[] = LOOKS.map(({ ability }) => ability)

export function abilityName(ability: Ability): string {
  return lookOf(ability).name
}

/** How something was done: "jumped", "took a jump pad". */
export function abilityDone(ability: Ability): string {
  return lookOf(ability).done
}

const OUTCOME_NAMES: Record<Outcome, string> = {
  [Outcome.UNSPECIFIED]: 'None yet',
  [Outcome.REACHED]: 'Reached',
  [Outcome.FELL]: 'Fell',
  [Outcome.BURNT]: 'Burnt',
  [Outcome.DROWNED]: 'Drowned',
  [Outcome.NO_PROGRESS]: 'Gave up',
  [Outcome.UNREACHABLE]: 'Unreachable',
  [Outcome.REACHED_NEAR]: 'Reached, beside others',
}

export function outcomeName(outcome: Outcome): string {
  return OUTCOME_NAMES[outcome] ?? 'Unknown'
}

export const STATE_NAMES: Record<NpcState, string> = { idle: 'Idle', seeking: 'On its way', down: 'Down' }

const STANDING_REASONS: Record<Standing, string> = {
  [Standing.UNSPECIFIED]: '',
  [Standing.NO_WORKER]: 'No worker has room for it. Start another worker.',
  [Standing.SILENT_WORKER]: 'Its worker does not answer.',
  [Standing.AWAITS_MAP]: 'Its worker is loading the map.',
  [Standing.AWAITS_GRAPH]: 'The planner is building the graph of the map.',
  [Standing.AWAITS_PLAN]: 'It has no plan yet.',
  [Standing.AWAITS_REHEARSAL]: 'It waits for its turn to rehearse.',
  [Standing.AWAITS_MOVER]: 'It waits for a lift, platform or door, or rides on one.',
  [Standing.AT_TARGET]: 'It keeps to its goal and is there.',
  [Standing.HOLDS]: 'It holds its place.',
  [Standing.RESTS]: 'It rests on its route, or until its next attempt.',
  [Standing.NO_PLACE]: 'It wanders, but its zone is gone or has no place to stand.',
  [Standing.AWAITS_GROUP]: 'It waits for the others of its group.',
  [Standing.BARRED]: 'Doors or other movers bar all ways to the goal.',
  [Standing.BLOCKED]: 'Something is in its way.',
}

/** Why an NPC stands; empty if it does not. */
export function standingReason(reason: Standing): string {
  return STANDING_REASONS[reason] ?? ''
}

/** What an NPC does by itself; empty if it has no route. */
export function routeName(route: RouteKind, stop: number): string {
  const names: Record<RouteKind, string> = {
    [RouteKind.UNSPECIFIED]: '',
    [RouteKind.PATROL]: `Patrol, stop ${stop} next`,
    [RouteKind.HOLD]: 'Hold',
    [RouteKind.WANDER]: 'Wander',
    [RouteKind.FLEE]: 'Flee',
  }
  return names[route] ?? ''
}

const NO_PATH_REASONS: Record<NoPath, string> = {
  [NoPath.UNSPECIFIED]: '',
  [NoPath.START_OFF_GRAPH]: 'No edge begins near the start.',
  [NoPath.GOAL_OFF_GRAPH]: 'No edge ends near the goal.',
  [NoPath.DIFFERENT_ISLANDS]: 'Start and goal are on different islands: no proved edge joins them.',
  [NoPath.ONE_WAY]: 'The path is one-way: it leads only from the goal to the start.',
  [NoPath.GOAL_IN_ZONE]: 'The goal is in a closed zone.',
}

export function noPathReason(reason: NoPath): string {
  return NO_PATH_REASONS[reason] || 'There is no path.'
}

export const PLACEMENTS: readonly { value: Placement; name: string }[] = [
  { value: Placement.SPACED, name: 'Spaced' },
  { value: Placement.RANDOM, name: 'Random' },
  { value: Placement.DENSITY, name: 'Density' },
  { value: Placement.TRAJECTORIES, name: 'Trajectories' },
  { value: Placement.TRAJECTORIES_TESTED, name: 'Trajectories, tested' },
  { value: Placement.FLOOD, name: 'Flood' },
  { value: Placement.FLOOD_GRANDCHILDREN, name: 'Flood with grandchildren' },
]

export function placementName(placement: Placement): string {
  return PLACEMENTS.find(({ value }) => value === placement)?.name ?? 'Spaced'
}
