// How many pixels are drawn, by how long pictures take. No renderer here.

const STEPS = [1, 0.8, 0.64, 0.5]
/** Pictures this much quicker than what counts as slow may have more pixels. */
const QUICK = 0.55
/** Pictures between two changes. */
const SETTLE = 14
/** Fewer pixels have to make pictures quicker by this share, or they are not worth it. */
const WORTH = 0.96
/** Pictures until fewer pixels are tried again after they were not worth it. */
const FUTILE = 400

/** Share of the full resolution that keeps pictures quick. */
export class ResolutionGovernor {
  private step = 0
  private mean = 0
  private pictures = 0
  /** Mean at the step before, while the last step down has yet to prove itself. */
  private before: number | undefined
  private futile = 0
  /** Finer steps that proved too slow are tried again ever later. */
  private patience = 1

  /** Pictures that take longer than `slowMs` are to have fewer pixels, but at least this share along each side. */
  constructor(
    private readonly slowMs: number,
    private readonly least: number,
  ) {}

  get share(): number {
    return STEPS[this.step]!
  }

  /** Takes in how long after the one before a picture came, both drawn without a pause between. */
  add(ms: number): void {
    const taken = Math.min(ms, 250)
    this.mean = this.pictures === 0 ? taken : this.mean + (taken - this.mean) * Math.max(0.15, 1 / (this.pictures + 1))
    this.pictures += 1
    this.futile = Math.max(0, this.futile - 1)
    if (this.pictures < SETTLE) {
      return
    }
    if (this.before !== undefined && this.mean > this.before * WORTH) {
      this.futile = FUTILE
      this.change(-1)
    } else if (this.mean > this.slowMs && this.futile === 0 && (STEPS[this.step + 1] ?? 0) >= this.least) {
      const { mean } = this
      this.patience = Math.min(16, this.patience * 2)
      this.change(1)
      this.before = mean
    } else if (this.pictures >= SETTLE * 5 * this.patience && this.mean < this.slowMs * QUICK && this.step > 0) {
      this.change(-1)
    } else {
      this.before = undefined
    }
  }

  private change(by: number): void {
    this.step += by
    this.pictures = 0
    this.before = undefined
  }
}

/** Counts the pictures of the last second, and what they cost. */
export class PictureCounter {
  private readonly pictures: { at: number; ms: number }[] = []

  /** Takes in when a picture was drawn, and how long the page worked on it. */
  add(at: number, ms: number): void {
    this.pictures.push({ at, ms })
    this.forget(at)
  }

  pace(now: number): { framesPerSecond: number; millisecondsPerFrame: number } {
    this.forget(now)
    const { length } = this.pictures
    const worked = this.pictures.reduce((sum, { ms }) => sum + ms, 0)
    return { framesPerSecond: length, millisecondsPerFrame: length > 0 ? worked / length : 0 }
  }

  private forget(now: number): void {
    while (this.pictures.length > 0 && this.pictures[0]!.at <= now - 1000) {
      this.pictures.shift()
    }
  }
}
