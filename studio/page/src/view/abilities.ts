// How abilities are named and drawn: one row for each, the least demanding first. No renderer here.

import { Ability } from '../gen/surefoot/world/v1/map_pb'

/** How an ability is named and drawn. */
export interface AbilityLook {
  readonly ability: Ability
  readonly name: string
  /** What a character did by it, as in "jumped". */
  readonly done: string
  readonly colour: string
  /** Height of an edge's arc over its chord: a share of its length, and no more than so many metres. */
  readonly arc: { readonly share: number; readonly most: number; readonly pieces: number }
}

const FLAT = { share: 0.02, most: 0.6, pieces: 2 }
const FLIGHT = { share: 0.1, most: 3, pieces: 5 }

const look = (ability: Ability, name: string, done: string, colour: string, arc: AbilityLook['arc']): AbilityLook => ({
  ability,
  name,
  done,
  colour,
  arc,
})

/** All abilities, the least demanding first. The last row stands for the moves that bodies bring along. */
export const LOOKS: readonly AbilityLook[] = [
  look(Ability.WALK, 'Walk', 'walked', '#6cbcff', FLAT),
  look(Ability.JUMP, 'Jump', 'jumped', '#ffa23a', { share: 0.16, most: 2.2, pieces: 4 }),
  look(Ability.DOUBLE_JUMP, 'Double jump', 'double-jumped', '#ff6238', { share: 0.24, most: 3.6, pieces: 5 }),
  look(Ability.PAD, 'Jump pad', 'took a jump pad', '#ffe23a', { share: 0.4, most: 12, pieces: 7 }),
  look(Ability.ZIP_LINE, 'Zip line', 'took a zip line', '#ff5cc8', { share: 0.08, most: 2.5, pieces: 4 }),
  look(Ability.TELEPORTER, 'Teleporter', 'took a teleporter', '#b487ff', { share: 0.25, most: 14, pieces: 8 }),
  look(Ability.JETPACK, 'Jetpack', 'used a jetpack', '#3af0d8', { share: 0.3, most: 10, pieces: 7 }),
  look(Ability.CLIMB, 'Climb', 'climbed', '#c79a4b', FLAT),
  look(Ability.MANTLE, 'Mantle', 'pulled itself up', '#f08a4b', FLAT),
  look(Ability.SWIM, 'Swim', 'swam', '#4ba0f0', FLAT),
  look(Ability.CROUCH, 'Crouch', 'crouched', '#a3b899', FLAT),
  look(Ability.DASH, 'Dash', 'dashed', '#ff6a6a', FLIGHT),
  look(Ability.WALL_RUN, 'Wall run', 'ran along a wall', '#ff9c7a', FLIGHT),
  look(Ability.SLIDE, 'Slide', 'slid', '#b8cc7a', FLAT),
  look(Ability.DIVE, 'Dive', 'dived', '#2b78c4', FLAT),
  look(Ability.OWN_1, 'Own move', 'made a move of its own', '#ff7aff', FLIGHT),
]

const byAbility = new Map(LOOKS.map((it) => [it.ability, it]))

/** The row of an ability: that of walking if it is unknown. */
export function lookOf(ability: Ability): AbilityLook {
  return byAbility.get(abilityKind(ability)) ?? LOOKS[0]!
}

/** The ability, or `OWN_1` for all moves that bodies bring along. */
export function abilityKind(ability: Ability): Ability {
  return ability >= Ability.OWN_1 ? Ability.OWN_1 : ability
}
