// Numbers and places as the page writes them.

import type { Place } from '../view/viewport.types'

const THOUSANDS = new Intl.NumberFormat('en')

export function count(value: number | bigint): string {
  return THOUSANDS.format(value)
}

/** "1 edge", "2 edges". */
export function counted(value: number | bigint, one: string, many = `${one}s`): string {
  return `${count(value)} ${Number(value) === 1 ? one : many}`
}

/** A share of 1 as "97 %", with a decimal where it would read as all or nothing. */
export function percent(share: number): string {
  const value = share * 100
  const edge = (value > 99 && value < 100) || (value > 0 && value < 1)
  const shown = edge ? Math.min(99.9, Math.max(0.1, value)).toFixed(1) : value.toFixed(0)
  return `${shown} %`
}

/** "0.85 s", "3.2 s", "42 s", "2 min 5 s", "1 h 3 min". */
export function duration(seconds: number): string {
  if (!Number.isFinite(seconds)) return '-'
  if (seconds < 1) return `${seconds.toFixed(2)} s`
  if (seconds < 9.95) return `${seconds.toFixed(1)} s`
  const whole = Math.round(seconds)
  if (whole < 60) return `${whole} s`
  const [minutes, rest] = [Math.floor(whole / 60), whole % 60]
  if (minutes < 60) return rest === 0 ? `${minutes} min` : `${minutes} min ${rest} s`
  return `${Math.floor(minutes / 60)} h ${minutes % 60} min`
}

/** Microseconds as milliseconds: "0.42 ms", "12 ms". */
export function millis(microseconds: number): string {
  const value = microseconds / 1000
  return `${value < 10 ? value.toFixed(2) : value.toFixed(0)} ms`
}

/** "31, 12, 40": metres, good enough to tell places apart. */
export function place(at: Place | undefined): string {
  return at === undefined ? '-' : `${tidy(at.x)}, ${tidy(at.y)}, ${tidy(at.z)}`
}

function tidy(metres: number): string {
  const text = metres.toFixed(0)
  return text === '-0' ? '0' : text
}

/** A factor: "x 2.5", "x 0.1", "x 1000". */
export function factor(value: number): string {
  return `x ${Number(value.toPrecision(2))}`
}

/** First characters of a hash. */
export function shortId(id: string): string {
  return id.slice(0, 8)
}

/** Seconds left of an operation with this progress; undefined if they cannot be estimated. */
export function timeLeft(done: number, total: number, elapsedSeconds: number): number | undefined {
  if (done <= 0 || total <= 0 || elapsedSeconds <= 0) return undefined
  return (Math.max(0, total - done) / done) * elapsedSeconds
}
