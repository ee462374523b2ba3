import { useEffect, useRef } from 'preact/hooks'
import { signal } from '@preact/signals'
import { abilityName } from '../data/abilities'
import { duration, percent, place } from '../data/format'
import type { Studio } from '../data/studio'
import { doing } from '../data/world/movers'
import { npcNumber } from '../data/world/snapshot'
import type { Hit } from '../view/viewport.types'
import { createViewport } from '../view/viewport'
import { Button, Empty } from './controls'
import { CreateWorldForm } from './map/create-world'
import { show } from './show'
import { clicked, dragged, hintFor } from './tools'
import { ViewBar } from './view-bar'
import { walkWithKeys } from './walk'
import { WatchBar } from './watch-bar'

const hovered = signal<Hit | undefined>(undefined)

/** The 3D view and its overlays. */
export function Stage({ studio }: { studio: Studio }) {
  const container = useRef<HTMLDivElement>(null)
  useEffect(() => (container.current === null ? undefined : mount(studio, container.current)), [studio])
  const tool = studio.tool.value
  return (
    <div class={`stage tool-${tool}`}>
      <div class="canvas" ref={container} />
      <Overlay studio={studio} />
      <ViewBar studio={studio} />
      <p class="hint" role="status">
        {hintFor(studio)}
      </p>
      <WatchBar studio={studio} />
      <HoverLine studio={studio} />
    </div>
  )
}

function mount(studio: Studio, container: HTMLElement): () => void {
  try {
    const viewport = createViewport(container, {
      click: (hit) => clicked(studio, hit),
      hover: (hit) => (hovered.value = hit),
      vertexDragged: (index, to) => dragged(studio, index, to),
      followingEnded: () => (studio.npcs.camera.value = false),
      lookedAround: () => {
        studio.looks.value += 1
        if (studio.link.peek() === undefined) studio.opening.value = false
      },
      detailWanted: (around, radius) => studio.level.want(around, radius),
    })
    // First, since the level clears the view before it is loaded into it.
    studio.viewport.value = viewport
    const ends = [show(studio, viewport), walkWithKeys(studio, viewport)]
    return () => {
      studio.viewport.value = undefined
      for (const end of ends) end()
      viewport.dispose()
    }
  } catch (error) {
    studio.viewportFailure.value = error instanceof Error ? error.message : String(error)
    return () => undefined
  }
}

/** What stands in place of the map while there is none. */
function Overlay({ studio }: { studio: Studio }) {
  const { worlds, level, context } = studio
  const { session } = context.world
  if (studio.viewportFailure.value !== '') {
    return (
      <div class="overlay">
        <Empty title="The map cannot be drawn">
          <p>{studio.viewportFailure.value}</p>
          <p>The panels work without it.</p>
        </Empty>
      </div>
    )
  }
  if (worlds.state.value === 'loading' && session.refused.value) {
    return (
      <div class="overlay">
        <Empty title={`${session.origin} asks for a token`}>
          <div class="row">
            <Button
              label="Enter a token"
              icon="key"
              tone="main"
              onClick={() => session.ask(`${session.origin} asks for a token.`)}
            />
          </div>
        </Empty>
      </div>
    )
  }
  if (worlds.state.value === 'loading') {
    return (
      <div class="overlay">
        <Empty title={`Looking for worlds at ${context.world.address} …`} />
      </div>
    )
  }
  if (worlds.creating.value) {
    return (
      <p class="loading" role="status">
        Creating the world …
      </p>
    )
  }
  if (worlds.chosen.value === undefined) {
    return (
      <div class="overlay">
        <Empty title="No world yet">
          <p>Create one to see NPCs move.</p>
          <CreateWorldForm studio={studio} />
        </Empty>
      </div>
    )
  }
  const state = level.state.value
  if (state.kind === 'failed') {
    return (
      <div class="overlay">
        <Empty title="The map did not load">
          <p>{state.why}</p>
        </Empty>
      </div>
    )
  }
  if (state.kind !== 'loading') return null
  return (
    <p class="loading" role="status">
      Loading the map{state.total > 0 ? `: ${state.done} of ${state.total} tiles` : ' …'}
    </p>
  )
}

/** What lies under the pointer, in words. */
function HoverLine({ studio }: { studio: Studio }) {
  const hit = hovered.value
  return <p class="hover-line">{hit === undefined ? '' : hitInWords(studio, hit)}</p>
}

function hitInWords({ graphs, movers }: Studio, hit: Hit): string {
  switch (hit.kind) {
    case 'npc':
      return `NPC ${npcNumber(hit.id)}`
    case 'vertex':
      return `Vertex ${hit.index} at ${place(hit.at)}`
    case 'edge': {
      const edge = graphs.edge(hit.from, hit.to)
      if (edge === undefined) return ''
      const name = abilityName(edge.ability)
      return `Edge ${hit.from} to ${hit.to}: ${name}, ${percent(edge.chance)}, ${duration(edge.seconds)}`
    }
    case 'mover': {
      const mover = movers.list.value[hit.index]
      return mover === undefined ? '' : `${mover.name}, ${doing(mover.kind, movers.states.value.get(hit.index))}`
    }
    case 'ground':
      return place(hit.at)
  }
}
