// Between a factor of 0.1 to 1000 and a slider that shows its order of magnitude.

const LEAST = 0.1
const MOST = 1000

export function sliderOf(factor: number): number {
  return Math.log10(Math.min(MOST, Math.max(LEAST, factor)))
}

/** Two digits are all that a designer can mean. */
export function factorOf(slider: number): number {
  return Math.min(MOST, Math.max(LEAST, Number((10 ** slider).toPrecision(2))))
}
