// Which labels have room in a picture. No renderer here.

/** Pixels left free around a label. */
const MARGIN = 3

/** A label where it would stand, in pixels from the upper left corner. */
export interface PlacedLabel {
  key: string
  rank: number
  /** Metres from the eye. */
  depth: number
  left: number
  top: number
  width: number
  height: number
}

const overlap = (a: PlacedLabel, b: PlacedLabel): boolean =>
  a.left < b.left + b.width + MARGIN &&
  b.left < a.left + a.width + MARGIN &&
  a.top < b.top + b.height + MARGIN &&
  b.top < a.top + a.height + MARGIN

/** Labels that were shown count as this much nearer, so that they do not come and go. */
const STAYS = 0.7

/**
 * At most `most` labels of which no two overlap: low ranks first, and of one rank the nearest. `isSeen` is asked only
 * about labels that there is room for.
 */
export function chooseLabels(
  labels: readonly PlacedLabel[],
  shown: ReadonlySet<string>,
  most: number,
  isSeen: (label: PlacedLabel) => boolean,
): PlacedLabel[] {
  const weight = (label: PlacedLabel): number => label.depth * (shown.has(label.key) ? STAYS : 1)
  const sorted = [...labels].sort((a, b) => a.rank - b.rank || weight(a) - weight(b))
  const chosen: PlacedLabel[] = []
  for (const label of sorted) {
    if (chosen.length >= most) {
      break
    }
    if (!chosen.some((other) => overlap(label, other)) && isSeen(label)) {
      chosen.push(label)
    }
  }
  return chosen
}
