import { ABILITIES, abilityName } from '../../data/abilities'
import { percent } from '../../data/format'
import { isFiltered, SHOW_ALL } from '../../data/graph/filter'
import type { Studio } from '../../data/studio'
import type { Ability } from '../../gen/surefoot/world/v1/map_pb'
import { lookOf } from '../../view/abilities'
import type { EdgeColour, GraphPresence } from '../../view/viewport.types'
import { BUSY_NPCS, chanceColour, formatColour, islandColour, secondsColour, trafficColour } from '../../view/colours'
import { AbilityDot, Button, Check, Choice, Ramp, Section, Slider } from '../controls'

const COLOURS: readonly { value: EdgeColour; name: string }[] = [
  { value: 'chance', name: 'Chance' },
  { value: 'seconds', name: 'Time' },
  { value: 'ability', name: 'Ability' },
  { value: 'island', name: 'Island' },
  { value: 'traffic', name: 'Traffic' },
]

const PRESENCES: readonly { value: GraphPresence; name: string }[] = [
  { value: 'full', name: 'Bright' },
  { value: 'faint', name: 'Faint' },
  { value: 'off', name: 'Hidden' },
]

export function FilterSection({ studio: { graphs } }: { studio: Studio }) {
  const filter = graphs.filter.value
  const toggle = (ability: Ability, on: boolean) => {
    const abilities = new Set(filter.abilities)
    if (on) abilities.add(ability)
    else abilities.delete(ability)
    graphs.setFilter({ abilities })
  }
  const { presence, colour } = filter
  return (
    <Section
      title="Edges shown"
      actions={
        isFiltered(filter) && (
          <Button label="Show all" onClick={() => graphs.setFilter({ ...SHOW_ALL, presence, colour })} />
        )
      }
    >
      <Choice
        label="Edges are"
        value={presence}
        options={PRESENCES}
        onChange={(presence) => graphs.setFilter({ presence })}
      />
      <Choice
        label="Colour by"
        value={colour}
        options={COLOURS}
        onChange={(colour) => graphs.setFilter({ colour, presence: 'full' })}
      />
      <Legend colour={colour} />
      <div class="checks" role="group" aria-label="Abilities">
        {ABILITIES.map((ability) => (
          <label class="check" key={ability}>
            <input
              type="checkbox"
              checked={filter.abilities.has(ability)}
              onChange={(event) => toggle(ability, event.currentTarget.checked)}
            />
            <AbilityDot ability={ability} />
            <span>{abilityName(ability)}</span>
          </label>
        ))}
      </div>
      <Slider
        label="Chance from"
        min={0}
        max={1}
        step={0.01}
        value={filter.minChance}
        shown={percent(filter.minChance)}
        onInput={(value) => graphs.setFilter({ minChance: value, maxChance: Math.max(value, filter.maxChance) })}
      />
      <Slider
        label="Chance up to"
        min={0}
        max={1}
        step={0.01}
        value={filter.maxChance}
        shown={percent(filter.maxChance)}
        onInput={(value) => graphs.setFilter({ maxChance: value, minChance: Math.min(value, filter.minChance) })}
      />
      <div class="checks">
        <Check
          label="Only one-way"
          checked={filter.onlyOneWay}
          onChange={(onlyOneWay) => graphs.setFilter({ onlyOneWay })}
        />
        <Check
          label="Only edited"
          checked={filter.onlyEdited}
          onChange={(onlyEdited) => graphs.setFilter({ onlyEdited })}
        />
      </div>
    </Section>
  )
}

const RAMPS = {
  chance: [chanceColour, '0 %', '100 %'],
  seconds: [secondsColour, 'quick', 'slow'],
  traffic: [trafficColour, 'nobody', `${BUSY_NPCS} NPCs`],
} as const

function Legend({ colour }: { colour: EdgeColour }) {
  if (colour === 'ability') {
    return (
      <p class="legend-row">
        {ABILITIES.map((ability) => (
          <span key={ability} title={abilityName(ability)} style={{ background: lookOf(ability).colour }} />
        ))}
      </p>
    )
  }
  if (colour === 'island') {
    return (
      <>
        <p class="legend-row">
          {[0, 1, 2, 3, 4, 5].map((island) => (
            <span key={island} style={{ background: formatColour(islandColour(island)) }} />
          ))}
        </p>
        <p class="note">One colour: these places are all connected to each other.</p>
      </>
    )
  }
  const [ramp, low, high] = RAMPS[colour]
  return <Ramp colour={ramp} low={low} high={high} />
}
