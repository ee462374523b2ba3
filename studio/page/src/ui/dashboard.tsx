import type { ComponentChildren } from 'preact'
import { useComputed } from '@preact/signals'
import { STATE_NAMES } from '../data/abilities'
import { count, counted, millis, percent } from '../data/format'
import type { Studio } from '../data/studio'
import { countStates, healthOf } from '../data/world/snapshot'
import type { NpcState } from '../view/viewport.types'
import { STATE_COLOURS } from '../view/colours'
import { Sparkline } from './sparkline'

const STATES: readonly NpcState[] = ['seeking', 'idle', 'down']

/** How the world is doing, in one line. */
export function Dashboard({ studio: { live, context } }: { studio: Studio }) {
  const states = useComputed(() => countStates(live.npcs.value))
  const health = useComputed(() => healthOf(live.samples.value))
  const stats = live.stats.value
  if (stats === undefined) return <footer class="dashboard" aria-label="Dashboard" />
  const { decisionsPerSecond, inTime, success, attempts } = health.value
  const isStale = context.world.link.state.value === 'lost'
  return (
    <footer class={`dashboard ${isStale ? 'stale' : ''}`} aria-label="Dashboard">
      <Figure name="Tick, median">{millis(stats.tickUsP50)}</Figure>
      <Figure name="Tick, p99">
        {millis(stats.tickUsP99)}
        <Sparkline values={live.samples.value.map((sample) => sample.stats.tickUsP99)} label="Tick time, p99" />
      </Figure>
      <Figure name="Late">{count(stats.ticksLate)}</Figure>
      <Figure name="Dropped">{count(stats.ticksDropped)}</Figure>
      <Figure name="NPCs">
        {STATES.map((state) => (
          <span class="state" key={state} title={STATE_NAMES[state]}>
            <i class="dot" style={{ background: STATE_COLOURS[state] }} />
            {states.value[state]}
            <span class="hidden">{STATE_NAMES[state]}</span>
          </span>
        ))}
      </Figure>
      <Figure name="Decisions">
        {decisionsPerSecond === undefined ? '-' : `${count(Math.round(decisionsPerSecond))}/s`}
      </Figure>
      <Figure name="In time">{inTime === undefined ? '-' : percent(inTime)}</Figure>
      <Figure name="Success so far">
        {success === undefined ? '-' : percent(success)}
        <small>of {count(attempts)}</small>
      </Figure>
      {stats.npcsWithoutWorker > 0 && (
        <p class="figure warning" role="status">
          {counted(stats.npcsWithoutWorker, 'NPC')} without a worker
        </p>
      )}
    </footer>
  )
}

function Figure({ name, children }: { name: string; children: ComponentChildren }) {
  return (
    <p class="figure">
      <span class="name">{name}</span>
      <span class="value">{children}</span>
    </p>
  )
}
