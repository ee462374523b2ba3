import { useComputed } from '@preact/signals'
import { counted } from '../../data/format'
import type { Studio } from '../../data/studio'
import { doing, isOpen, lostWithout, MOVER_KINDS } from '../../data/world/movers'
import { type Mover, MoverKind } from '../../gen/surefoot/world/v1/living_pb'
import { Button, Section } from '../controls'

/** The doors, lifts and other movers of a world: what they do, and what one could tell them. */
export function MoversSection({ studio }: { studio: Studio }) {
  const { movers, graphs } = studio
  const lost = useComputed(() => {
    const [graph, locked] = [graphs.loaded.value, movers.locked.value]
    if (graph === undefined || locked.size === 0) return undefined
    return lostWithout(graph, movers.given.value).length
  })
  if (movers.list.value.length === 0) return null
  return (
    <Section title={counted(movers.list.value.length, 'mover')}>
      <ul class="list movers" aria-label="Movers">
        {movers.list.value.map((mover, index) => (
          <MoverRow key={mover.name} studio={studio} mover={mover} index={index} />
        ))}
      </ul>
      {lost.value !== undefined && (
        <p class="note" role="status">
          {lost.value === 0
            ? 'Everything stays reachable without the locked movers.'
            : `Unreachable without the locked movers: ${counted(lost.value, 'vertex', 'vertices')}, shown on the map.`}
        </p>
      )}
    </Section>
  )
}

function MoverRow({ studio, mover, index }: { studio: Studio; mover: Mover; index: number }) {
  const { movers, worlds } = studio
  const state = movers.states.value.get(index)
  const tell = (order: Parameters<typeof movers.order>[2]) => {
    const world = worlds.chosenId.peek()
    if (world !== undefined) void movers.order(world, mover.name, order)
  }
  const opens = mover.kind === MoverKind.DOOR || mover.kind === MoverKind.FLOOR
  const opened = isOpen(mover.kind, state)
  const [open, shut] = mover.kind === MoverKind.DOOR ? ['Open', 'Shut'] : ['Bring back', 'Take away']
  const canLock = mover.kind !== MoverKind.CONVEYOR && mover.kind !== MoverKind.CRATE
  return (
    <li>
      <span>
        <strong>{mover.name}</strong> {MOVER_KINDS[mover.kind]}, {doing(mover.kind, state)}
      </span>
      <div class="row wrap" role="group" aria-label={`Orders for ${mover.name}`}>
        {opens && <Button label={opened ? shut : open} onClick={() => tell({ case: 'open', value: !opened })} />}
        {mover.kind === MoverKind.CRATE && <Button label="Put back" onClick={() => tell({ case: 'stop', value: 0 })} />}
        {!opens &&
          mover.stops.length > 1 &&
          mover.stops.map((_, stop) => (
            <Button
              key={stop}
              label={`Stop ${stop + 1}`}
              pressed={state?.toldStop === stop}
              onClick={() => tell({ case: 'stop', value: stop })}
            />
          ))}
        {mover.stops.length > 1 && (
          <Button
            label="To and fro"
            pressed={state !== undefined && state.toldStop === undefined}
            onClick={() => tell({ case: 'cycle', value: true })}
          />
        )}
        {canLock && (
          <Button
            label="What if locked?"
            pressed={movers.locked.value.has(index)}
            hint="Shows what becomes unreachable without it, and plans without it. Nothing moves."
            onClick={() => movers.toggleLock(index)}
          />
        )}
      </div>
    </li>
  )
}
