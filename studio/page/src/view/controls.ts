// Pointer, wheel and keys on the canvas, as gestures.

const CLICK_MOUSE = 4
const CLICK_TOUCH = 10
const HOVER_MS = 34
/** Pixels a second that a held key moves the map by. */
const KEY_SPEED = 620

/** Pixels from the upper left corner of the canvas. */
export interface PointerPlace {
  x: number
  y: number
  touch: boolean
}

export interface Gestures {
  rotate(dx: number, dy: number): void
  pan(dx: number, dy: number): void
  zoom(factor: number, x: number, y: number): void
  click(x: number, y: number, event: PointerEvent): void
  hover(at: PointerPlace | undefined): void
  /** Whether the thing under the pointer is to be dragged rather than the map. */
  grab(at: PointerPlace): boolean
  drag(x: number, y: number): void
  /** `moved`: it was a drag and not a click. */
  letGo(moved: boolean): void
  /** Left button turns the map, or moves it. */
  turns(): boolean
  wake(): void
}

interface Held {
  x: number
  y: number
}

const PANS: Record<string, [number, number]> = {
  ArrowLeft: [1, 0],
  KeyA: [1, 0],
  ArrowRight: [-1, 0],
  KeyD: [-1, 0],
  ArrowUp: [0, 1],
  KeyW: [0, 1],
  ArrowDown: [0, -1],
  KeyS: [0, -1],
}
const TURNS: Record<string, [number, number]> = { KeyQ: [1, 0], KeyE: [-1, 0], PageUp: [0, 1], PageDown: [0, -1] }
const ZOOMS: Record<string, number> = { Equal: -1, NumpadAdd: -1, Minus: 1, NumpadSubtract: 1 }

type Mode = 'turn' | 'pan' | 'pinch' | 'drag'

export class Controls {
  private readonly held = new Map<number, Held>()
  private readonly keys = new Set<string>()
  private readonly ends = new AbortController()
  private mode: Mode | undefined
  private start: Held = { x: 0, y: 0 }
  private moved = false
  private hoverTimer: number | undefined
  private hoverAt: PointerPlace | undefined
  private hovered = 0

  constructor(
    private readonly canvas: HTMLCanvasElement,
    private readonly gestures: Gestures,
  ) {
    canvas.tabIndex = 0
    canvas.setAttribute('role', 'application')
    canvas.setAttribute(
      'aria-label',
      '3D view of the map. Drag or Q and E to turn, shift and drag or arrow keys to move, wheel or plus and minus to zoom.',
    )
    this.listen('pointerdown', (event) => this.down(event))
    this.listen('pointermove', (event) => this.move(event))
    this.listen('pointerup', (event) => this.up(event))
    this.listen('pointercancel', (event) => this.cancel(event))
    this.listen('pointerleave', () => this.leave())
    this.listen('contextmenu', (event) => event.preventDefault())
    this.listen('wheel', (event) => this.wheel(event))
    this.listen('keydown', (event) => this.keyDown(event))
    this.listen('keyup', (event) => this.keys.delete(event.code))
    this.listen('blur', () => this.keys.clear())
  }

  /** Moves by the keys that are held; tells whether there are any. */
  update(elapsed: number): boolean {
    const step = (KEY_SPEED * elapsed) / 1000
    for (const key of this.keys) {
      const [panX, panY] = PANS[key] ?? [0, 0]
      const [turnX, turnY] = TURNS[key] ?? [0, 0]
      if (panX || panY) {
        this.gestures.pan(panX * step, panY * step)
      } else if (turnX || turnY) {
        this.gestures.rotate(turnX * step * 0.6, turnY * step * 0.4)
      } else {
        const { clientWidth, clientHeight } = this.canvas
        this.gestures.zoom(Math.exp((ZOOMS[key] ?? 0) * elapsed * 0.0016), clientWidth / 2, clientHeight / 2)
      }
    }
    return this.keys.size > 0
  }

  dispose(): void {
    this.ends.abort()
    clearTimeout(this.hoverTimer)
  }

  private listen<K extends keyof HTMLElementEventMap>(name: K, act: (event: HTMLElementEventMap[K]) => void): void {
    this.canvas.addEventListener(name, act, { signal: this.ends.signal, passive: false })
  }

  private at(event: MouseEvent): Held {
    const box = this.canvas.getBoundingClientRect()
    return { x: event.clientX - box.left, y: event.clientY - box.top }
  }

  private down(event: PointerEvent): void {
    const at = this.at(event)
    this.canvas.setPointerCapture(event.pointerId)
    this.held.set(event.pointerId, at)
    if (this.held.size === 1) {
      this.start = at
      this.moved = false
      this.mode = this.modeOf(event, at)
    } else {
      this.mode = 'pinch'
      this.moved = true
    }
  }

  private modeOf(event: PointerEvent, { x, y }: Held): Mode {
    const touch = event.pointerType === 'touch'
    if (event.button === 0 && !event.shiftKey && this.gestures.grab({ x, y, touch })) {
      return 'drag'
    }
    const other = event.button !== 0 || event.shiftKey
    return other === this.gestures.turns() ? 'pan' : 'turn'
  }

  private move(event: PointerEvent): void {
    const at = this.at(event)
    const before = this.held.get(event.pointerId)
    if (!before) {
      this.hoverSoon({ ...at, touch: event.pointerType === 'touch' })
      return
    }
    const reach = event.pointerType === 'touch' ? CLICK_TOUCH : CLICK_MOUSE
    this.moved ||= Math.hypot(at.x - this.start.x, at.y - this.start.y) > reach
    if (this.mode === 'pinch') {
      this.pinch(event.pointerId, before, at)
    } else if (this.moved && this.mode === 'drag') {
      this.gestures.drag(at.x, at.y)
    } else if (this.moved && this.mode === 'pan') {
      this.gestures.pan(at.x - before.x, at.y - before.y)
    } else if (this.moved) {
      this.gestures.rotate(at.x - before.x, at.y - before.y)
    }
    // Before the threshold the start stays where it was, so that the map does not lag behind the pointer.
    if (this.moved) {
      this.held.set(event.pointerId, at)
    }
  }

  /** One of two fingers has moved: half of its way moves the map, and their distance zooms. */
  private pinch(id: number, before: Held, at: Held): void {
    const other = [...this.held].find(([key]) => key !== id)?.[1]
    if (!other) {
      return
    }
    const apart = (a: Held): number => Math.max(10, Math.hypot(a.x - other.x, a.y - other.y))
    this.gestures.pan((at.x - before.x) / 2, (at.y - before.y) / 2)
    this.gestures.zoom(apart(before) / apart(at), (at.x + other.x) / 2, (at.y + other.y) / 2)
  }

  private up(event: PointerEvent): void {
    if (!this.held.delete(event.pointerId)) {
      return
    }
    const { x, y } = this.at(event)
    if (this.mode === 'drag') {
      this.gestures.letGo(this.moved)
    }
    if (!this.moved && event.button === 0 && this.held.size === 0) {
      this.gestures.click(x, y, event)
    }
    this.mode = this.held.size === 1 && this.mode === 'pinch' ? 'pan' : undefined
  }

  private cancel(event: PointerEvent): void {
    this.held.delete(event.pointerId)
    if (this.mode === 'drag') {
      this.gestures.letGo(false)
    }
    this.mode = undefined
  }

  private leave(): void {
    if (this.held.size === 0) {
      this.hoverSoon(undefined)
    }
  }

  /** Not more often than thirty times a second; the last place always counts. */
  private hoverSoon(at: PointerPlace | undefined): void {
    if (at?.touch) {
      return
    }
    this.hoverAt = at
    this.hoverTimer ??= window.setTimeout(
      () => {
        this.hoverTimer = undefined
        this.hovered = performance.now()
        this.gestures.hover(this.hoverAt)
      },
      Math.max(0, HOVER_MS - (performance.now() - this.hovered)),
    )
  }

  private wheel(event: WheelEvent): void {
    event.preventDefault()
    const pixels = event.deltaY * (event.deltaMode === 1 ? 30 : event.deltaMode === 2 ? 300 : 1)
    const { x, y } = this.at(event)
    const speed = event.ctrlKey ? 0.01 : 0.0013
    this.gestures.zoom(Math.exp(Math.min(400, Math.max(-400, pixels)) * speed), x, y)
  }

  private keyDown(event: KeyboardEvent): void {
    const known = event.code in PANS || event.code in TURNS || event.code in ZOOMS
    if (!known || event.ctrlKey || event.metaKey || event.altKey) {
      return
    }
    event.preventDefault()
    this.keys.add(event.code)
    this.gestures.wake()
  }
}
