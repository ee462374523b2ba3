import type { ComponentChildren } from 'preact'
import { useMemo } from 'preact/hooks'
import { abilityName } from '../../data/abilities'
import { GAITS, type Motion, legKind, type LegKind, motionAt } from '../../data/world/motion'
import type { Replays } from '../../data/world/replays'
import { Ability } from '../../gen/surefoot/world/v1/map_pb'
import { lookOf } from '../../view/abilities'
import { type Axis, axisOf, degrees, fromTop, HEADING_STEPS, linePoints, SPEED_STEPS, timeTicks } from './axis'
import { Field } from './field'

/** Steps of an axis at most. */
const [VALUE_STEPS, TIME_LABELS] = [3, 7]
const LEG_COLOURS: Record<LegKind, string> = {
  walk: lookOf(Ability.WALK).colour,
  leap: lookOf(Ability.JUMP).colour,
  device: lookOf(Ability.ZIP_LINE).colour,
}
const LEG_KINDS: readonly LegKind[] = ['walk', 'leap', 'device']
const GAIT_AXIS: Axis = { low: -0.5, high: GAITS.length - 0.5, ticks: GAITS.map((_, index) => index) }

interface Curves {
  heading: Curve
  speed: Curve
  gait: Curve
}

interface Curve {
  axis: Axis
  points: string
}

/** Heading, speed and gait of a replay over the time; a click, a drag or a key chooses the moment. */
export function MotionPlots({ replays }: { replays: Replays }) {
  const motion = replays.shown.value?.motion
  const curves = useMemo(() => motion && curvesOf(motion), [motion])
  if (motion === undefined || curves === undefined) return null
  const length = replays.length.value
  const { heading, speed, gait, leg } = motionAt(motion, replays.seconds.value)
  const shown = {
    heading: `${degrees(heading).toFixed(0)}°`,
    speed: `${speed.toFixed(1)} m/s`,
    gait,
    leg: leg === undefined ? 'no plan' : leg.ability === undefined ? 'off the graph' : abilityName(leg.ability),
  }
  return (
    <div class="motion" role="group" aria-label="Motion">
      <div class="motion-values">
        <Value name="Leg" value={shown.leg} kind="legs" />
        <Value name="Heading" value={shown.heading} axis={curves.heading.axis} label={(tick) => `${tick}°`} />
        <Value name="Speed" value={shown.speed} axis={curves.speed.axis} label={(tick) => String(tick)} />
        <Value name="Gait" value={shown.gait} axis={GAIT_AXIS} label={(tick) => GAITS[tick]!} kind="gaits" />
        <span class="motion-unit">Time, s</span>
      </div>
      <Field replays={replays} text={`heading ${shown.heading}, ${shown.speed}, ${gait}, leg: ${shown.leg}`}>
        <Legs motion={motion} length={length} />
        <Plot curve={curves.heading} length={length} />
        <Plot curve={curves.speed} length={length} />
        <Plot curve={curves.gait} length={length} kind="gaits" />
        <Flights motion={motion} length={length} />
        <div class="motion-times">
          {timeTicks(length, TIME_LABELS).map((tick) => (
            <span key={tick} style={{ left: share(tick, length) }}>
              {tick}
            </span>
          ))}
        </div>
      </Field>
      <Legend hasLegs={motion.legs.length > 0} hasFlights={motion.flights.length > 0} />
    </div>
  )
}

function curvesOf({ samples, gaits }: Motion): Curves {
  const headings = samples.map(({ at, heading }) => [at, degrees(heading)] as const)
  const speeds = samples.map(({ at, speed }) => [at, speed] as const)
  const steps = gaits.flatMap(({ from, to, gait }) => {
    const row = GAITS.indexOf(gait)
    return [[from, row] as const, [to, row] as const]
  })
  const curve = (points: readonly (readonly [number, number])[], axis: Axis) => ({
    axis,
    points: linePoints(points, axis),
  })
  return {
    heading: curve(
      headings,
      axisOf(
        headings.map(([, value]) => value),
        HEADING_STEPS,
        VALUE_STEPS,
      ),
    ),
    speed: curve(speeds, axisOf([0, ...speeds.map(([, value]) => value)], SPEED_STEPS, VALUE_STEPS)),
    gait: curve(steps, GAIT_AXIS),
  }
}

/** The name of a plot, its value at the moment, and the labels of its axis. */
function Value(props: { name: string; value: string; axis?: Axis; label?: (tick: number) => string; kind?: string }) {
  const { name, value, axis, label, kind = '' } = props
  return (
    <div class={`motion-value ${kind}`}>
      <span class="name">{name}</span>
      <span class="number">{value}</span>
      {axis?.ticks.map((tick) => (
        <span key={tick} class="tick" style={{ top: `${fromTop(tick, axis) * 100}%` }}>
          {label?.(tick)}
        </span>
      ))}
    </div>
  )
}

function Plot({ curve: { axis, points }, length, kind = '' }: { curve: Curve; length: number; kind?: string }) {
  return (
    <Drawing length={length} kind={kind}>
      {axis.ticks.map((tick) => (
        <line key={tick} class="grid" x1={0} x2={length} y1={fromTop(tick, axis)} y2={fromTop(tick, axis)} />
      ))}
      <polyline points={points} />
    </Drawing>
  )
}

/** A field as wide as the time is long and 1 high, stretched to its place. */
function Drawing({ length, kind, children }: { length: number; kind: string; children: ComponentChildren }) {
  return (
    <svg class={`motion-plot ${kind}`} viewBox={`0 0 ${length} 1`} preserveAspectRatio="none" aria-hidden="true">
      {children}
    </svg>
  )
}

function Legs({ motion: { legs }, length }: { motion: Motion; length: number }) {
  return (
    <div class="motion-legs">
      {legs.map(({ from, to, ability }) => {
        const colour = ability === undefined ? undefined : LEG_COLOURS[legKind(ability)]
        return (
          <i
            key={from}
            class={colour === undefined ? 'off' : ''}
            title={ability === undefined ? 'Off the graph' : abilityName(ability)}
            style={{ left: share(from, length), width: share(to - from, length), '--leg': colour }}
          />
        )
      })}
    </div>
  )
}

function Flights({ motion: { flights }, length }: { motion: Motion; length: number }) {
  return (
    <>
      {flights.map(({ from, to }) => (
        <i key={from} class="flight" style={{ left: share(from, length), width: share(to - from, length) }} />
      ))}
    </>
  )
}

function Legend({ hasLegs, hasFlights }: { hasLegs: boolean; hasFlights: boolean }) {
  return (
    <p class="motion-legend">
      {hasLegs &&
        LEG_KINDS.map((kind) => (
          <span key={kind}>
            <i class="dot" style={{ background: LEG_COLOURS[kind] }} /> {kind}
          </span>
        ))}
      {hasFlights && <span>▲ take-off ▼ landing</span>}
      {!hasLegs && <span>It had no plan.</span>}
    </p>
  )
}

function share(seconds: number, length: number): string {
  return `${length > 0 ? (seconds / length) * 100 : 0}%`
}
