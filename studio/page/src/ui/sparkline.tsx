const WIDTH = 64
const HEIGHT = 18

/** A series of values as a line, scaled to the largest value. */
export function Sparkline({ values, label }: { values: readonly number[]; label: string }) {
  if (values.length < 2) return null
  return (
    <svg
      class="sparkline"
      width={WIDTH}
      height={HEIGHT}
      viewBox={`0 0 ${WIDTH} ${HEIGHT}`}
      role="img"
      aria-label={label}
    >
      <polyline points={sparkPoints(values, WIDTH, HEIGHT)} />
    </svg>
  )
}

/** Points of the line, a pixel away from the edges. */
export function sparkPoints(values: readonly number[], width: number, height: number): string {
  const most = Math.max(...values, Number.MIN_VALUE)
  const step = (width - 2) / Math.max(1, values.length - 1)
  return values
    .map(
      (value, index) => `${(1 + index * step).toFixed(1)},${(height - 1 - (value / most) * (height - 2)).toFixed(1)}`,
    )
    .join(' ')
}
