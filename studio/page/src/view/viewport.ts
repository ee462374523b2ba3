// The 3D view: puts its parts together and draws when something has changed.

import { Aim } from './aim'
import { CameraRig } from './camera-rig'
import { Controls } from './controls'
import { DetailWish } from './detail'
import { FeatureView } from './features'
import { GraphView } from './graph-view'
import { Hand } from './hand'
import { Materials } from './materials'
import { NpcView } from './npcs'
import { setSeeThrough } from './overlays'
import { PoseBuffer } from './poses'
import { PictureCounter, ResolutionGovernor } from './quality'
import { MarkerView, MarkView, PathView } from './routes'
import { SelectionView } from './selection'
import { Stage } from './stage'
import { type Box, Terrain } from './terrain'
import { paletteOf } from './theme'
import { TrackView } from './track'
import { Trails } from './trails'
import { samePlace, VertexDrag } from './vertex-drag'
import type {
  EditMark,
  Features,
  Graph,
  GraphFilter,
  Hit,
  MeshTile,
  NpcPose,
  PathLine,
  Place,
  SelectedNpc,
  Theme,
  Viewport,
  ViewportEvents,
} from './viewport.types'

export {
  ABILITY_COLOURS,
  chanceColour,
  formatColour,
  islandColour,
  MARK_COLOURS,
  secondsColour,
  STATE_COLOURS,
  SURFACE_COLOURS,
} from './colours'
export { secondsRange } from './edge-shape'

/** The camera counts as standing still so long after its last move, ms. */
const REST_MS = 180
/** Trails fade for so long after the last move, ms. */
const TRAIL_MS = 5200

/** @throws Error if the browser offers no WebGL 2. */
export function createViewport(container: HTMLElement, events: Partial<ViewportEvents>): Viewport {
  return new View(container, events)
}

class View implements Viewport {
  private readonly palette = paletteOf({ dark: true })
  private readonly stage: Stage
  private readonly materials = new Materials()
  private readonly rig: CameraRig
  private readonly terrain = new Terrain(this.materials, this.palette)
  private readonly features = new FeatureView(this.materials, this.palette)
  private readonly graph = new GraphView(this.materials, this.palette)
  private readonly paths = new PathView(this.materials)
  private readonly markers = new MarkerView(this.materials)
  private readonly marks = new MarkView(this.materials)
  private readonly npcs = new NpcView(this.materials)
  private readonly trails = new Trails(this.materials)
  private readonly selection = new SelectionView(this.materials)
  private readonly track = new TrackView(this.materials)
  private readonly drag = new VertexDrag(this.materials)
  private readonly poses = new PoseBuffer()
  private readonly aim: Aim
  private readonly hand: Hand
  private readonly controls: Controls
  private readonly detail = new DetailWish((around, radius) => this.events.detailWanted?.(around, radius))
  private readonly resizes: ResizeObserver
  private readonly counter = new PictureCounter()
  /** A moving picture is to be quick, a standing one sharp. */
  private readonly roaming = new ResolutionGovernor(31, 0.5)
  private readonly standing = new ResolutionGovernor(55, 0.64)
  private request: number | undefined
  private restTimer: number | undefined
  private last = 0
  private running: ResolutionGovernor | undefined
  private cameraMoved = 0
  private npcMoved = -TRAIL_MS
  private stillChanged = true
  private movingChanged = true
  private scale = 1
  private framed = false
  private disposed = false

  constructor(
    container: HTMLElement,
    private readonly events: Partial<ViewportEvents>,
  ) {
    this.stage = new Stage(container)
    const { stage } = this
    this.rig = new CameraRig(stage.camera)
    stage.still.add(this.terrain, this.features, this.graph, this.paths, this.markers, this.marks)
    stage.moving.add(this.trails.lines, this.npcs, this.selection, this.track, this.drag)
    this.aim = new Aim({ stage, rig: this.rig, terrain: this.terrain, graph: this.graph, poses: this.poses })
    const { rig, aim, drag: vertex } = this
    this.hand = new Hand({ stage, rig, aim, vertex, events, changed: () => this.changeMoving() })
    this.controls = new Controls(stage.canvas, this.hand)
    this.resizes = new ResizeObserver(() => this.resize(container))
    this.resizes.observe(container)
    stage.canvas.addEventListener('webglcontextrestored', () => this.change())
    this.setTheme({ dark: true })
    this.resize(container)
  }

  clear(): void {
    this.terrain.clearTiles()
    this.features.set(undefined)
    this.graph.setGraph(undefined)
    this.graph.select(undefined, undefined)
    this.paths.set([])
    this.markers.set({ start: undefined, goal: undefined, nearest: undefined })
    this.marks.setEdits([])
    this.marks.setDifference([], [])
    this.poses.clear()
    this.trails.clear()
    this.selection.set(undefined)
    this.track.stop()
    this.drag.end()
    this.rig.following = undefined
    this.framed = false
    this.detail.forget()
    this.change()
  }

  setFeatures(features: Features): void {
    this.features.set(features)
    this.frameOnce()
    this.change()
  }

  putTile(tile: MeshTile, fine: boolean): void {
    this.terrain.put(tile, fine, this.rig.pose.target)
    const box = this.terrain.box()
    if (box) {
      this.rig.setExtent(box)
    }
    this.change()
  }

  fineTiles(): ReadonlySet<string> {
    return this.terrain.fineKeys
  }

  setNpcs(tick: bigint, npcs: NpcPose[]): void {
    const count = this.poses.shown.length
    this.poses.receive(Number(tick), npcs, performance.now())
    this.movingChanged ||= count !== npcs.length
    this.wake()
  }

  setTrails(visible: boolean): void {
    this.trails.lines.visible = visible
    this.changeMoving()
  }

  setSelectedNpc(npc: SelectedNpc | undefined): void {
    this.selection.set(npc)
    this.changeMoving()
  }

  follow(id: bigint | undefined): void {
    this.rig.following = id
    this.wake()
  }

  setGraph(graph: Graph | undefined): void {
    const { held } = this.drag
    const vertex = held && graph?.vertices[held.index]
    // Graphs come anew all the time: what is in the user's hand stays there if it is still what it was.
    if (held && (!vertex || vertex.removed || !samePlace(vertex.position, held.from))) {
      this.drag.end()
    }
    this.graph.setGraph(graph)
    this.change()
  }

  setGraphFilter(filter: GraphFilter): void {
    this.graph.setFilter(filter)
    this.change()
  }

  selectVertex(index: number | undefined): void {
    this.graph.select(index, this.graph.selection.edge)
    this.change()
  }

  selectEdge(edge: { from: number; to: number } | undefined): void {
    this.graph.select(this.graph.selection.vertex, edge)
    this.change()
  }

  setDraggable(draggable: boolean): void {
    this.hand.draggable = draggable
  }

  setPickable(kinds: ReadonlySet<Hit['kind']> | undefined): void {
    this.aim.pickable = kinds
  }

  setPaths(paths: PathLine[]): void {
    this.paths.set(paths)
    this.change()
  }

  setMarkers(start: Place | undefined, goal: Place | undefined, nearest: Place | undefined): void {
    this.markers.set({ start, goal, nearest })
    this.change()
  }

  setEditMarks(marks: EditMark[]): void {
    this.marks.setEdits(marks)
    this.change()
  }

  setDifference(lost: Place[], gained: Place[]): void {
    this.marks.setDifference(lost, gained)
    this.change()
  }

  playTrack(track: Float32Array, reached: boolean, done: () => void): void {
    this.track.play(track, reached, done)
    this.changeMoving()
  }

  setSection(height: number | undefined): void {
    this.materials.setSection(height)
    this.terrain.setSection(height !== undefined)
    this.aim.section = height
    this.change()
  }

  setTopView(top: boolean): void {
    this.rig.setTop(top)
    this.wake()
  }

  frameMap(): void {
    this.rig.following = undefined
    this.frame(this.framed)
    this.wake()
  }

  lookAt(place: Place): void {
    this.rig.following = undefined
    this.rig.lookAt(place)
    this.wake()
  }

  setTheme(theme: Theme): void {
    const palette = paletteOf(theme)
    this.materials.setPalette(palette)
    this.stage.setBackground(palette.background)
    this.terrain.setPalette(palette)
    this.features.setPalette(palette)
    this.graph.setPalette(palette)
    this.change()
  }

  snapshot(): { width: number; height: number; pixels: Uint8Array } {
    this.advance(performance.now(), 0)
    this.setQuick(false)
    this.stage.draw(false)
    return this.stage.read()
  }

  framesPerSecond(): number {
    return this.counter.perSecond(performance.now())
  }

  dispose(): void {
    this.disposed = true
    cancelAnimationFrame(this.request ?? 0)
    clearTimeout(this.restTimer)
    this.detail.dispose()
    this.resizes.disconnect()
    this.controls.dispose()
    this.terrain.clearTiles()
    for (const part of [this.features, this.graph, this.paths, this.markers, this.marks, this.npcs, this.trails]) {
      part.dispose()
    }
    this.selection.dispose()
    this.track.dispose()
    this.drag.dispose()
    this.materials.dispose()
    this.stage.dispose()
  }

  /** What stands still has changed. */
  private change(): void {
    this.stillChanged = true
    this.aim.invalidate()
    this.wake()
  }

  private changeMoving(): void {
    this.movingChanged = true
    this.wake()
  }

  private wake(): void {
    if (this.request === undefined && !this.disposed) {
      this.request = requestAnimationFrame((now) => this.tick(now))
    }
  }

  private tick(now: number): void {
    this.request = undefined
    const pause = now - this.last
    this.last = now
    const goesOn = this.advance(now, this.running ? Math.min(pause, 100) : 16)
    if (this.stillChanged || this.movingChanged) {
      this.draw(now, pause)
    } else {
      this.running = undefined
    }
    if (goesOn) {
      this.wake()
    } else {
      this.running = undefined
    }
  }

  /** Moves everything on; tells whether there is more to come. */
  private advance(now: number, elapsed: number): boolean {
    const keys = this.controls.update(elapsed)
    const npcs = this.poses.advance(now, elapsed)
    const played = this.track.update(now / 1000, this.stage.camera.position, this.scale)
    const { following } = this.rig
    const camera = this.rig.update(elapsed, following === undefined ? undefined : this.poses.find(following))
    if (camera) {
      this.cameraMoved = now
      this.stillChanged = true
      this.aim.invalidate()
      this.detail.moved(this.rig.pose)
    }
    if (npcs) {
      this.npcMoved = now
    }
    const trails = this.trails.lines.visible && now - this.npcMoved < TRAIL_MS
    this.movingChanged ||= npcs || played || trails
    this.place(now)
    return keys || npcs || played || camera || trails
  }

  /** Puts everything where it is to be drawn. */
  private place(now: number): void {
    const { stage, rig, materials } = this
    const { width, height } = stage.size
    this.scale = rig.apply(width, height)
    const { uniforms } = materials
    uniforms.uScale.value = this.scale
    uniforms.uRatio.value = stage.ratio
    uniforms.uHalf.value.set(stage.canvas.width / 2, stage.canvas.height / 2)
    uniforms.uNear.value = stage.camera.near
    uniforms.uThin.value = Math.min(1, Math.max(0.6, 1.2 - rig.pose.distance / 900))
    uniforms.uFogRange.value.set(...rig.fogRange())
    const eye = stage.camera.position
    const selected = this.selection.selected?.id
    this.npcs.update(this.poses.shown, {
      eye,
      scale: this.scale,
      polar: rig.pose.polar,
      ceiling: this.aim.section ?? Infinity,
      selected,
    })
    if (this.trails.lines.visible) {
      this.trails.update(this.poses.shown, now / 1000)
    }
    this.selection.update(selected === undefined ? undefined : this.poses.find(selected), eye, this.scale)
    this.markers.scaleFor(eye, this.scale)
  }

  private draw(now: number, pause: number): void {
    const moved = now - this.cameraMoved
    const governor = moved < REST_MS ? this.roaming : this.standing
    if (this.running === governor) {
      governor.add(pause)
    }
    this.running = governor
    if (this.stage.setShare(governor.share)) {
      this.place(now)
      this.stillChanged = true
    }
    if (this.stillChanged) {
      this.stage.invalidate()
      this.setQuick(this.stage.software && governor === this.roaming)
    }
    this.stage.draw(!this.stillChanged)
    this.counter.add(now)
    this.stillChanged = false
    this.movingChanged = false
    if (governor === this.roaming && (this.stage.software || this.roaming.share < 1)) {
      this.sharpenSoon()
    }
  }

  /** Leaves out what can be missed while the camera moves. */
  private setQuick(quick: boolean): void {
    this.terrain.setQuick(quick, this.stage.camera)
    setSeeThrough(this.stage.still, !quick)
    setSeeThrough(this.stage.moving, !quick)
  }

  /** Once the camera rests, draws with all pixels again. */
  private sharpenSoon(): void {
    clearTimeout(this.restTimer)
    this.restTimer = window.setTimeout(() => this.change(), REST_MS + 20)
  }

  private resize(container: HTMLElement): void {
    this.stage.resize(container.clientWidth, container.clientHeight)
    this.change()
  }

  private frameOnce(): void {
    if (!this.framed) {
      this.frame(false)
      this.framed = true
    }
  }

  private frame(flight: boolean): void {
    const box = this.terrain.box() ?? this.featureBox()
    const { width, height } = this.stage.size
    if (box) {
      this.rig.setExtent(box)
      this.rig.frame(box, width / height, flight)
      this.framed = true
    }
  }

  private featureBox(): Box | undefined {
    const { size } = this.features
    return size && { low: { x: 0, y: 0, z: 0 }, high: { x: size.width, y: size.height * 0.6, z: size.depth } }
  }
}
