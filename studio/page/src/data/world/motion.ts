// How an NPC moved in an attempt: what the plots beside the replay show.

import { Ability } from '../../gen/surefoot/world/v1/map_pb'
import { Support } from '../../gen/surefoot/world/v1/world_pb'
import type { Place } from '../../view/viewport.types'
import { isSame } from './npcs'
import type { Pose } from './recorder'

const TICKS_A_SECOND = 60
/** An NPC of which nothing came for longer than this had not changed until then, ticks. */
const SILENT_TICKS = 12
/** Slower than this it stands, m/s. */
const STILL_M_S = 0.2
/** Standing it turns from here on, rad/s. */
const TURN_RAD_S = 0.3
/** It walks and jogs up to these shares of its top speed: half-way between those of the gaits in the guide. */
const [WALK_SHARE, JOG_SHARE] = [0.19, 0.625]

/** A leg begins at one of so many waypoints before its own: places off the plan, to let others pass, come between. */
const RECENT_PLACES = 3

/** How an NPC gets along, the least first. */
export const GAITS = ['idle', 'turn', 'walk', 'jog', 'run', 'air', 'ride'] as const
export type Gait = (typeof GAITS)[number]

/** What a leg of a plan asks for. */
export type LegKind = 'walk' | 'leap' | 'device'

/** At a moment, `at` seconds after the start. */
export interface Sample {
  at: number
  /** Unwrapped: without jumps at half a turn, rad. */
  heading: number
  /** Horizontal, m/s. */
  speed: number
}

/** From one moment to another, s. */
export interface Span {
  from: number
  to: number
}

export interface GaitSpan extends Span {
  gait: Gait
}

export interface LegSpan extends Span {
  /** Undefined where no edge of the graph leads there, as from the start to the first vertex. */
  ability: Ability | undefined
}

export interface Motion {
  samples: readonly Sample[]
  gaits: readonly GaitSpan[]
  /** From take-off to landing, of jumps and what devices throw; not of steps and drops. */
  flights: readonly Span[]
  /** Legs of its plans; none while it has no plan. */
  legs: readonly LegSpan[]
}

/** What is needed to read poses. */
export interface MotionFacts {
  /** Top speed of the NPC's body, m/s. */
  topSpeed: number
  /** What the edge between two vertices needs; undefined: there is none. */
  abilityBetween: (from: Place, to: Place) => Ability | undefined
}

/** Reads the poses of an attempt, at least one. */
export function motionOf(received: readonly Pose[], { topSpeed, abilityBetween }: MotionFacts): Motion {
  const poses = withoutGaps(received)
  const first = poses[0]!.tick
  const times = poses.map(({ tick }) => (tick - first) / TICKS_A_SECOND)
  const headings = unwrapped(poses.map(({ yaw }) => yaw))
  const samples = poses.map(({ speed }, index) => ({ at: times[index]!, heading: headings[index]!, speed }))
  const gaits = poses.map((pose, index) => gaitOf(pose, turnRate(samples, index), topSpeed))
  return {
    samples,
    gaits: runsOf(times, gaits).map(({ value, ...span }) => ({ ...span, gait: value })),
    flights: flightsOf(times, poses),
    legs: legsOf(times, poses, abilityBetween),
  }
}

/** All values at a moment. */
export function motionAt({ samples, gaits, legs }: Motion, at: number): Sample & { gait: Gait; leg?: LegSpan } {
  const next = samples.findIndex((sample) => sample.at > at)
  const high = samples[next < 0 ? samples.length - 1 : next]!
  const low = samples[next < 0 ? samples.length - 1 : Math.max(0, next - 1)]!
  const share = high.at > low.at ? Math.max(0, (at - low.at) / (high.at - low.at)) : 0
  const mix = (a: number, b: number): number => a + (b - a) * share
  const gait = (spanAt(gaits, at) ?? gaits.at(-1)!).gait
  const leg = spanAt(legs, at)
  return {
    at,
    heading: mix(low.heading, high.heading),
    speed: mix(low.speed, high.speed),
    gait,
    ...(leg && { leg }),
  }
}

export function legKind(ability: Ability): LegKind {
  if (ability === Ability.JUMP || ability === Ability.DOUBLE_JUMP) return 'leap'
  return ability === Ability.WALK || ability === Ability.UNSPECIFIED ? 'walk' : 'device'
}

/** Headings without jumps at half a turn: neighbours differ by at most that. */
export function unwrapped(headings: readonly number[]): number[] {
  let turns = 0
  return headings.map((heading, index) => {
    const step = index === 0 ? 0 : heading - headings[index - 1]!
    turns -= Math.round(step / (2 * Math.PI))
    return heading + turns * 2 * Math.PI
  })
}

/** With poses that repeat what held until something came again after a silence. */
function withoutGaps(poses: readonly Pose[]): Pose[] {
  return poses.flatMap((pose, index) => {
    const before = poses[index - 1]
    const isSilent = before !== undefined && pose.tick - before.tick > SILENT_TICKS
    return isSilent ? [{ ...before, tick: pose.tick - 1 }, pose] : [pose]
  })
}

/** From this sample to the next, rad/s. */
function turnRate(samples: readonly Sample[], index: number): number {
  const [now, next] = [samples[index]!, samples[index + 1]]
  return next === undefined ? 0 : (next.heading - now.heading) / (next.at - now.at)
}

function gaitOf({ support, speed }: Pose, turning: number, topSpeed: number): Gait {
  if (support === Support.AIR) return 'air'
  if (support === Support.ZIP_LINE) return 'ride'
  if (speed < STILL_M_S) return Math.abs(turning) > TURN_RAD_S ? 'turn' : 'idle'
  if (speed < WALK_SHARE * topSpeed) return 'walk'
  return speed < JOG_SHARE * topSpeed ? 'jog' : 'run'
}

/** Runs of equal values; each lasts until the next begins. */
function runsOf<T>(times: readonly number[], values: readonly T[]): (Span & { value: T })[] {
  const runs: (Span & { value: T })[] = []
  values.forEach((value, index) => {
    const [at, last] = [times[index]!, runs.at(-1)]
    if (last !== undefined) last.to = at
    if (last === undefined || last.value !== value) runs.push({ from: at, to: at, value })
  })
  return runs
}

function flightsOf(times: readonly number[], poses: readonly Pose[]): Span[] {
  const isInAir = poses.map(({ support }) => support === Support.AIR)
  return runsOf(times, isInAir)
    .filter(({ from, to, value }) => {
      // The ability of a decision is known for sure only once the next one is made.
      const abilities = poses.filter((_, index) => times[index]! >= from && times[index]! <= to)
      return value && abilities.some(({ ability }) => ability > Ability.WALK)
    })
    .map(({ from, to }) => ({ from, to }))
}

function legsOf(times: readonly number[], poses: readonly Pose[], abilityBetween: MotionFacts['abilityBetween']) {
  const legs: LegSpan[] = []
  const abilities = new Map<Place, Ability | undefined>()
  for (const { from, to, value } of runsOf(times, poses.map(({ waypoint }) => waypoint).map(sameAsBefore()))) {
    if (value === undefined) continue
    // It comes back to a leg after it went out of the way of others.
    if (!abilities.has(value)) {
      const starts = [...abilities.keys()].slice(-RECENT_PLACES).reverse()
      abilities.set(
        value,
        starts.map((start) => abilityBetween(start, value)).find((ability) => ability !== undefined),
      )
    }
    legs.push({ from, to, ability: abilities.get(value) })
  }
  return legs
}

/** Gives equal places the same object. */
function sameAsBefore(): (place: Place | undefined) => Place | undefined {
  const places: Place[] = []
  return (place) => {
    if (place === undefined) return undefined
    const found = places.find((known) => isSame(known, place))
    if (found === undefined) places.push(place)
    return found ?? place
  }
}

function spanAt<T extends Span>(spans: readonly T[], at: number): T | undefined {
  return spans.filter(({ from, to }) => from <= at && at <= to).at(-1)
}
