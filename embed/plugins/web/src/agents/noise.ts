// Noise of actions: repeatable, and each agent's its own.

/** A stream of random numbers that a seed decides. */
export class Noise {
  private state: number

  constructor(seed: number) {
    this.state = seed >>> 0
  }

  /** The next number from a Gaussian with mean 0 and deviation 1. */
  gaussian(): number {
    // Box-Muller; 1 - u keeps the logarithm finite.
    const radius = Math.sqrt(-2 * Math.log(1 - this.uniform()))
    return radius * Math.cos(2 * Math.PI * this.uniform())
  }

  /** The next number of Mulberry32, 0 to 1 without the latter. */
  private uniform(): number {
    this.state = (this.state + 0x6d2b79f5) >>> 0
    let mixed = this.state
    mixed = Math.imul(mixed ^ (mixed >>> 15), mixed | 1)
    mixed ^= mixed + Math.imul(mixed ^ (mixed >>> 7), mixed | 61)
    return ((mixed ^ (mixed >>> 14)) >>> 0) / 2 ** 32
  }
}
