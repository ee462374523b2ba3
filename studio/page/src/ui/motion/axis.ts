// Axes of plots. No markup here.

const DEGREES = 180 / Math.PI
/** Steps between ticks: degrees, m/s and seconds. */
export const HEADING_STEPS = [45, 90, 180, 360, 720, 1440, 3600, 7200]
export const SPEED_STEPS = [1, 2, 5, 10, 20, 50]
export const TIME_STEPS = [0.5, 1, 2, 5, 10, 20, 60, 120, 300]

export interface Axis {
  low: number
  high: number
  ticks: readonly number[]
}

/** An axis from tick to tick around the values, with the smallest step that leaves at most `most` steps. */
export function axisOf(values: readonly number[], steps: readonly number[], most: number): Axis {
  const [least, greatest] = values.reduce(
    ([low, high], value) => [Math.min(low, value), Math.max(high, value)],
    [Infinity, -Infinity],
  )
  const span = (step: number) => {
    const low = Math.floor(least / step)
    return { low, count: Math.max(1, Math.ceil(greatest / step) - low) }
  }
  const step = steps.find((step) => span(step).count <= most) ?? steps.at(-1)!
  const { low, count } = span(step)
  const ticks = Array.from({ length: count + 1 }, (_, index) => (low + index) * step)
  return { low: ticks[0]!, high: ticks[count]!, ticks }
}

/** Ticks of the time axis, none beyond its end, s. */
export function timeTicks(length: number, most: number): number[] {
  return axisOf([0, length], TIME_STEPS, most).ticks.filter((tick) => tick <= length)
}

/** Share of the height at which a value lies, from the top. */
export function fromTop(value: number, { low, high }: Axis): number {
  return (high - value) / (high - low)
}

/** Points of a polyline in a field as wide as the time is long and 1 high. */
export function linePoints(points: readonly (readonly [at: number, value: number])[], axis: Axis): string {
  return points.map(([at, value]) => `${at.toFixed(3)},${fromTop(value, axis).toFixed(4)}`).join(' ')
}

export function degrees(radians: number): number {
  return radians * DEGREES
}
