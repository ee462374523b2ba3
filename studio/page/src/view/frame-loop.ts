// When a picture is drawn: asks the browser for pictures while something moves, and chooses how sharp they are.

import { PictureCounter, ResolutionGovernor } from './quality'
import type { Stage } from './stage'

/** The camera counts as standing still so long after its last move, ms. */
const REST_MS = 180

/** What the loop moves on and puts in place. */
export interface Show {
  /** Moves everything on by `elapsed` ms; tells whether there is more to come. */
  advance(now: number, elapsed: number): boolean
  /** Puts everything where it is to be drawn. */
  place(now: number): void
  /** Leaves out what can be missed while the camera moves, or shows it again. */
  setQuick(quick: boolean): void
  /** What stands still has another place in the picture now. */
  stillChanged(): void
  /** A picture has been drawn. */
  drawn(now: number): void
}

export class FrameLoop {
  private readonly counter = new PictureCounter()
  /** A moving picture is to be quick, a standing one sharp. */
  private readonly roaming = new ResolutionGovernor(31, 0.5)
  private readonly standing = new ResolutionGovernor(55, 0.64)
  private request: number | undefined
  private restTimer: number | undefined
  private last = 0
  private running: ResolutionGovernor | undefined
  private cameraMovedAt = 0
  private stillChanged = true
  private movingChanged = true
  private disposed = false

  constructor(
    private readonly stage: Stage,
    private readonly show: Show,
  ) {}

  /** What stands still has changed. */
  change(): void {
    this.markStill()
    this.wake()
  }

  /** What moves has changed. */
  changeMoving(): void {
    this.markMoving()
    this.wake()
  }

  /** As `changeMoving`, for a picture that is being made already. */
  markMoving(): void {
    this.movingChanged = true
  }

  /** The camera has moved in the picture that is being made. */
  cameraMoved(now: number): void {
    this.cameraMovedAt = now
    this.markStill()
  }

  /** Asks for a picture. */
  wake(): void {
    if (this.request === undefined && !this.disposed) {
      this.request = requestAnimationFrame((now) => this.tick(now))
    }
  }

  pace(): { framesPerSecond: number; millisecondsPerFrame: number } {
    return this.counter.pace(performance.now())
  }

  dispose(): void {
    this.disposed = true
    cancelAnimationFrame(this.request ?? 0)
    clearTimeout(this.restTimer)
  }

  private markStill(): void {
    this.stillChanged = true
    this.show.stillChanged()
  }

  private tick(now: number): void {
    const began = performance.now()
    this.request = undefined
    const pause = now - this.last
    this.last = now
    const goesOn = this.show.advance(now, this.running ? Math.min(pause, 100) : 16)
    if (this.stillChanged || this.movingChanged) {
      this.draw(now, pause)
      this.counter.add(now, performance.now() - began)
    } else {
      this.running = undefined
    }
    if (goesOn) {
      this.wake()
    } else {
      this.running = undefined
    }
  }

  private draw(now: number, pause: number): void {
    const moved = now - this.cameraMovedAt
    const governor = moved < REST_MS ? this.roaming : this.standing
    if (this.running === governor) {
      governor.add(pause)
    }
    this.running = governor
    if (this.stage.setShare(governor.share)) {
      this.show.place(now)
      this.stillChanged = true
    }
    if (this.stillChanged) {
      this.stage.invalidate()
      this.show.setQuick(this.stage.software && governor === this.roaming)
    }
    this.stage.draw(!this.stillChanged)
    this.show.drawn(now)
    this.stillChanged = false
    this.movingChanged = false
    if (governor === this.roaming && (this.stage.software || this.roaming.share < 1)) {
      this.sharpenSoon()
    }
  }

  /** Once the camera rests, draws with all pixels again. */
  private sharpenSoon(): void {
    clearTimeout(this.restTimer)
    this.restTimer = window.setTimeout(() => this.change(), REST_MS + 20)
  }
}
