// The level of the example: boxes on a floor, a wall with a gap, and steps to jump up.

/** A solid box by its lowest and highest corners, m. */
export interface Box {
  low: [number, number, number]
  high: [number, number, number]
}

export const BOXES: Box[] = [
  { low: [-20, -1, -20], high: [20, 0, 20] },
  // The wall is too high to jump over; its gap lies on the right.
  { low: [-20, -0.5, -0.5], high: [11, 6, 0.5] },
  { low: [17, -0.5, -0.5], high: [20, 6, 0.5] },
  // Steps of 1.5 m up to a platform.
  { low: [-4, -0.5, -16], high: [0, 1.5, -12] },
  { low: [-8.5, -0.5, -16], high: [-4.5, 3, -12] },
  { low: [-18, -0.5, -17], high: [-9, 4.5, -11] },
  // Crates.
  { low: [4, -0.5, 6], high: [7, 2, 9] },
  { low: [-9, -0.5, 8], high: [-6, 1.2, 11] },
  { low: [8, -0.5, -9], high: [10, 3, -5] },
]

/** Where the NPC begins. */
export const START = { x: -14, y: 0, z: 14 }

/** Corners of each face of a box, counter-clockwise seen from outside; bit n of a corner's index picks the high side of axis n. */
const FACES = [
  [0, 4, 6, 2],
  [1, 3, 7, 5],
  [0, 1, 5, 4],
  [2, 6, 7, 3],
  [0, 2, 3, 1],
  [4, 5, 7, 6],
]

/** The level as a Wavefront OBJ file, which `surefoot` reads. A page with a model of its own gives it the .glb. */
export function levelObj(): string {
  const lines = BOXES.flatMap(({ low, high }, idx) => [
    `o box${idx}`,
    ...Array.from({ length: 8 }, (_, corner) => {
      const place = [0, 1, 2].map((axis) => (((corner >> axis) & 1) === 1 ? high : low)[axis])
      return `v ${place.join(' ')}`
    }),
    ...FACES.map((face) => `f ${face.map((corner) => 8 * idx + corner + 1).join(' ')}`),
  ])
  return lines.join('\n') + '\n'
}

/** The lowest corner of the level, from which follows where the level lies on its map. */
export function lowestCorner() {
  const least = (axis: 0 | 1 | 2) => Math.min(...BOXES.map(({ low }) => low[axis]))
  return { x: least(0), y: least(1), z: least(2) }
}
