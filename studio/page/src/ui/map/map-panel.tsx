import { count, counted } from '../../data/format'
import type { Studio } from '../../data/studio'
import { mapOf } from '../../data/world/worlds'
import { Surface } from '../../gen/surefoot/world/v1/world_pb'
import { SURFACE_COLOURS } from '../../view/colours'
import { Empty, Facts, Section, SureButton } from '../controls'
import { CreateWorldForm } from './create-world'
import { ImportLevel } from './import-level'
import { bodyName } from './kinds'
import { MarksSection } from './marks-section'
import { MoversSection } from './movers-section'
import { PiecesSection } from './pieces-section'
import { SurveyTable } from './survey-table'

export function MapPanel({ studio }: { studio: Studio }) {
  return (
    <>
      <WorldList studio={studio} />
      <LevelFacts studio={studio} />
      <MoversSection studio={studio} />
      <PiecesSection studio={studio} />
      <MarksSection studio={studio} />
      <Section title="New world">
        <CreateWorldForm studio={studio} />
      </Section>
      <Section title="Import a level">
        <ImportLevel studio={studio} />
      </Section>
    </>
  )
}

function WorldList({ studio: { worlds } }: { studio: Studio }) {
  const list = worlds.list.value
  return (
    <Section title="Worlds">
      {list.length === 0 && worlds.state.value === 'ready' && <Empty title="No world yet" />}
      <ul class="list worlds" aria-label="Worlds">
        {list.map((world) => (
          <li key={world.worldId} class={world.worldId === worlds.chosenId.value ? 'chosen' : ''}>
            <button
              type="button"
              class="item"
              aria-pressed={world.worldId === worlds.chosenId.value}
              onClick={() => worlds.choose(world.worldId)}
            >
              <strong>World {String(world.worldId)}</strong>
              <span>{`${worlds.nameOf(world)} · ${counted(world.npcCount, 'NPC')}`}</span>
            </button>
            <SureButton
              label={`Drop world ${world.worldId}`}
              question="Drop the world and its NPCs?"
              icon="trash"
              bare
              onSure={() => void worlds.drop(world.worldId)}
            />
          </li>
        ))}
      </ul>
    </Section>
  )
}

function LevelFacts({ studio }: { studio: Studio }) {
  const { level, worlds } = studio
  const features = level.features.value
  const world = worlds.chosen.value
  if (features === undefined || world === undefined) return null
  const { width, height, depth } = features.size
  const pools = (lava: boolean) => features.pools.filter((pool) => pool.lava === lava).length
  const state = level.state.value
  const rows: [name: string, surface: Surface, number: number][] = [
    ['Water pools', Surface.WATER, pools(false)],
    ['Lava pools', Surface.LAVA, pools(true)],
    ['Jump pads', Surface.PAD, features.pads.length],
    ['Zip lines', Surface.ZIP_LINE, features.zipLines.length],
    ['Teleporters', Surface.TELEPORTER, features.teleporters.length],
    ['Jetpacks', Surface.JETPACK, features.jetpacks.length],
  ]
  return (
    <Section title="Map">
      <Facts
        rows={[
          ['Extent', `${width} x ${depth} m, ${height} m high`],
          ['Body', world.bodies.map((body) => bodyName(body)).join('; ')],
          ['NPCs', world.solidNpcs ? "get in each other's way" : 'pass through one another'],
          ['Hash', <code title={world.mapHash}>{world.mapHash.slice(0, 16)}</code>],
          ...(state.kind === 'ready'
            ? [['Loaded', `${counted(state.tiles, 'tile')} in ${state.seconds.toFixed(1)} s`] as const]
            : []),
        ]}
      />
      <ul class="legend" aria-label="Features">
        {rows
          .filter(([, , number]) => number > 0)
          .map(([name, surface, number]) => (
            <li key={name}>
              <i class="dot" style={{ background: SURFACE_COLOURS[surface] }} />
              {name} <span class="number">{count(number)}</span>
            </li>
          ))}
      </ul>
      <SurveyTable
        studio={studio}
        of={studio.site.value?.mapHash ?? world.mapHash}
        map={{ ...mapOf(world), pieces: [...(studio.site.value?.pieces ?? [])] }}
        isShown
      />
    </Section>
  )
}
