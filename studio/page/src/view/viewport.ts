// The 3D view as the page uses it: hands what the page says to the parts of the scene, and moves them on.

import { Aim } from './aim'
import { CameraRig } from './camera-rig'
import { Clip, pictureOf } from './capture'
import { type Angles, chaseAngles } from './chase'
import { Controls } from './controls'
import { DetailWish } from './detail'
import { FrameLoop, type Show } from './frame-loop'
import { Hand } from './hand'
import { LabelLayer } from './labels'
import { lensOf } from './orbit'
import { PoseBuffer, type ShownNpc } from './poses'
import { Scene } from './scene'
import { Stage } from './stage'
import { samePlace } from './vertex-drag'
import type {
  Box,
  CameraPose,
  ClipRecording,
  EditMark,
  Features,
  Graph,
  GraphFilter,
  Hit,
  Label,
  LabelGroup,
  MeshTile,
  MoverPose,
  MoverShape,
  NpcPose,
  PathLine,
  Place,
  PlayerPose,
  ReachArea,
  Replay,
  SelectedNpc,
  Theme,
  Viewport,
  ViewportEvents,
  Traffic,
} from './viewport.types'

export {
  chanceColour,
  formatColour,
  islandColour,
  MARK_COLOURS,
  secondsColour,
  STATE_COLOURS,
  SURFACE_COLOURS,
} from './colours'
export { secondsRange } from './edge-shape'

/** Trails fade for so long after the last move, ms. */
const TRAIL_MS = 5200
/** How often the camera looks for better angles to follow from, ms. */
const STEER_MS = 300
/** Names are shown at least so far around what the camera looks at, and while it is nearer than this to that, m. */
const NAMED_M = 45
const MOST_NAMED_M = 150

/** @throws Error if the browser offers no WebGL 2. */
export function createViewport(container: HTMLElement, events: Partial<ViewportEvents>): Viewport {
  return new View(container, events)
}

class View implements Viewport, Show {
  private readonly stage: Stage
  private readonly scene: Scene
  private readonly rig: CameraRig
  private readonly poses = new PoseBuffer()
  private readonly aim: Aim
  private readonly hand: Hand
  private readonly controls: Controls
  private readonly detail = new DetailWish((around, radius) => this.events.detailWanted?.(around, radius))
  private readonly resizes: ResizeObserver
  private readonly frames: FrameLoop
  private readonly labels: LabelLayer
  private clip: Clip | undefined
  private steered = 0
  private npcMoved = -TRAIL_MS
  private scale = 1
  private framed = false

  constructor(
    container: HTMLElement,
    private readonly events: Partial<ViewportEvents>,
  ) {
    this.stage = new Stage(container)
    this.labels = new LabelLayer(container)
    this.scene = new Scene(this.stage)
    this.rig = new CameraRig(this.stage.camera)
    this.frames = new FrameLoop(this.stage, this)
    const { stage, rig, poses, frames } = this
    const { terrain, graph, movers, drag: vertex } = this.scene
    this.aim = new Aim({ stage, rig, terrain, graph, movers, poses })
    const { aim } = this
    const stopFollowing = () => this.stopFollowing()
    this.hand = new Hand({ stage, rig, aim, vertex, events, stopFollowing, changed: () => frames.changeMoving() })
    this.controls = new Controls(stage.canvas, this.hand)
    this.resizes = new ResizeObserver(() => this.resize(container))
    this.resizes.observe(container)
    stage.canvas.addEventListener('webglcontextrestored', () => frames.change())
    this.setTheme({ dark: true })
    this.resize(container)
  }

  clear(): void {
    this.scene.clear()
    this.poses.clear()
    this.labels.clear()
    this.rig.follow(undefined)
    this.framed = false
    this.detail.forget()
    this.frames.change()
  }

  setFeatures(features: Features): void {
    this.scene.features.set(features)
    this.frameOnce()
    this.frames.change()
  }

  putTile(tile: MeshTile, fine: boolean): void {
    this.scene.terrain.put(tile, fine, this.rig.pose.target)
    const box = this.scene.terrain.box()
    if (box) {
      this.rig.setExtent(box)
    }
    this.frames.change()
  }

  dropTile(key: string): void {
    this.scene.terrain.dropTile(key)
    this.frames.change()
  }

  fineTiles(): ReadonlySet<string> {
    return this.scene.terrain.fineKeys
  }

  setNpcs(tick: bigint, npcs: NpcPose[]): void {
    const count = this.poses.shown.length
    this.poses.receive(Number(tick), npcs, performance.now())
    if (count !== npcs.length) {
      this.frames.markMoving()
    }
    this.frames.wake()
  }

  setMovers(movers: MoverShape[]): void {
    this.scene.movers.set(movers)
    this.frames.changeMoving()
  }

  setMoverPoses(poses: ReadonlyMap<number, MoverPose>): void {
    this.scene.movers.place(poses)
    this.frames.changeMoving()
  }

  setPlayers(players: readonly PlayerPose[]): void {
    this.scene.movers.setPlayers(players)
    this.frames.changeMoving()
  }

  setTrails(visible: boolean): void {
    this.scene.trails.lines.visible = visible
    this.frames.changeMoving()
  }

  setSelectedNpc(npc: SelectedNpc | undefined): void {
    this.scene.selection.set(npc)
    this.frames.changeMoving()
  }

  follow(id: bigint | undefined): void {
    this.rig.follow(id)
    this.steered = -STEER_MS
    this.frames.wake()
  }

  setLabels(group: LabelGroup, labels: readonly Label[]): void {
    this.labels.set(group, labels)
    this.frames.changeMoving()
  }

  setLabelsVisible(visible: boolean): void {
    this.labels.setVisible(visible)
    this.frames.changeMoving()
  }

  setReplay(replay: Replay | undefined): void {
    this.scene.replay.set(replay)
    this.frames.changeMoving()
  }

  setOutline(box: Box | undefined): void {
    this.scene.outline.set(box)
    this.frames.change()
  }

  setGraph(graph: Graph | undefined): void {
    const { held } = this.scene.drag
    const vertex = held && graph?.vertices[held.index]
    // Graphs are replaced all the time. The object in the user's hand stays if it is unchanged.
    if (held && (!vertex || vertex.removed || !samePlace(vertex.position, held.from))) {
      this.scene.drag.end()
    }
    this.scene.graph.setGraph(graph)
    this.frames.change()
  }

  setTraffic(traffic: Traffic): void {
    if (this.scene.graph.setTraffic(traffic)) this.frames.change()
  }

  setGraphFilter(filter: GraphFilter): void {
    this.scene.graph.setFilter(filter)
    this.frames.change()
  }

  selectVertex(index: number | undefined): void {
    this.scene.graph.select(index, this.scene.graph.selection.edge)
    this.frames.change()
  }

  selectEdge(edge: { from: number; to: number } | undefined): void {
    this.scene.graph.select(this.scene.graph.selection.vertex, edge)
    this.frames.change()
  }

  setDraggable(draggable: boolean): void {
    this.hand.draggable = draggable
  }

  setPickable(kinds: ReadonlySet<Hit['kind']> | undefined): void {
    this.aim.pickable = kinds
  }

  setPaths(paths: PathLine[]): void {
    this.scene.paths.set(paths)
    this.frames.change()
  }

  setMarkers(start: Place | undefined, goal: Place | undefined, nearest: Place | undefined): void {
    this.scene.markers.set({ start, goal, nearest })
    this.frames.change()
  }

  setReachArea(area: ReachArea | undefined): void {
    this.scene.reach.set(area)
    this.frames.change()
  }

  setEditMarks(marks: EditMark[]): void {
    this.scene.marks.setEdits(marks)
    this.frames.change()
  }

  setDifference(lost: Place[], gained: Place[]): void {
    this.scene.marks.setDifference(lost, gained)
    this.frames.change()
  }

  playTrack(track: Float32Array, reached: boolean, done: () => void): void {
    this.scene.track.play(track, reached, done)
    this.frames.changeMoving()
  }

  setSection(height: number | undefined): void {
    this.scene.setSection(height)
    this.aim.section = height
    this.frames.change()
  }

  setTopView(top: boolean): void {
    this.rig.setTop(top)
    this.frames.wake()
  }

  frameMap(): void {
    this.stopFollowing()
    this.frame(this.framed)
    this.frames.wake()
  }

  lookAt(place: Place, within?: number): void {
    this.stopFollowing()
    this.rig.lookAt(place, within)
    this.frames.wake()
  }

  frameBox(box: Box): void {
    this.stopFollowing()
    const { width, height } = this.stage.size
    this.rig.frameFromHere(box, width / height)
    this.frames.wake()
  }

  moveCamera(by: Place): void {
    this.rig.move(by)
    this.frames.wake()
  }

  distanceToGround(origin: Place, direction: Place): number | undefined {
    return this.scene.terrain.cast({ origin, direction }, undefined)?.distance
  }

  camera(): CameraPose {
    return this.rig.kept
  }

  setCamera(pose: CameraPose): void {
    this.rig.restore(pose)
    this.framed = true
    this.frames.change()
  }

  setTheme(theme: Theme): void {
    this.scene.setTheme(theme)
    this.labels.setTheme(theme)
    this.frames.change()
  }

  snapshot(): { width: number; height: number; pixels: Uint8Array } {
    this.drawNow()
    return this.stage.read()
  }

  picture(): Promise<Blob> {
    this.stage.setShare(1)
    this.drawNow()
    this.frames.change()
    return pictureOf(this.layers)
  }

  record(): ClipRecording {
    const clip = new Clip(this.layers, () => {
      if (this.clip === clip) this.clip = undefined
    })
    this.clip = clip
    this.frames.change()
    return clip
  }

  pace(): { framesPerSecond: number; millisecondsPerFrame: number } {
    return this.frames.pace()
  }

  dispose(): void {
    this.frames.dispose()
    this.detail.dispose()
    this.resizes.disconnect()
    this.controls.dispose()
    this.labels.dispose()
    this.scene.dispose()
    this.stage.dispose()
  }

  advance(now: number, elapsed: number): boolean {
    const keys = this.controls.update(elapsed)
    const npcs = this.poses.advance(now, elapsed)
    const played = this.scene.track.update(now / 1000, this.stage.camera.position, this.scale)
    const { following } = this.rig
    const npc = following === undefined ? undefined : this.poses.find(following)
    if (npc?.snapped) {
      this.rig.arriveAgain()
      this.steered = -STEER_MS
    }
    if (npc && this.rig.steersItself && now - this.steered >= STEER_MS) {
      this.steered = now
      this.steer(npc)
    }
    const camera = this.rig.update(elapsed, npc && (this.scene.replay.place ?? npc))
    if (camera) {
      this.frames.cameraMoved(now)
      this.detail.moved(this.rig.pose)
    }
    if (npcs) {
      this.npcMoved = now
    }
    const trails = this.scene.trails.lines.visible && now - this.npcMoved < TRAIL_MS
    if (npcs || played || trails) {
      this.frames.markMoving()
    }
    this.place(now)
    return keys || npcs || played || camera || trails
  }

  place(now: number): void {
    const { stage, rig, scene } = this
    const { width, height } = stage.size
    this.scale = rig.apply(width, height)
    const { uniforms } = scene.materials
    uniforms.uScale.value = this.scale
    uniforms.uRatio.value = stage.ratio
    uniforms.uHalf.value.set(stage.canvas.width / 2, stage.canvas.height / 2)
    uniforms.uNear.value = stage.camera.near
    uniforms.uThin.value = Math.min(1, Math.max(0.6, 1.2 - rig.pose.distance / 900))
    uniforms.uFogRange.value.set(...rig.fogRange())
    uniforms.uSoftRange.value.set(rig.pose.distance + 10, rig.pose.distance * 2 + 60)
    const eye = stage.camera.position
    const selected = this.scene.selection.selected?.id
    this.scene.npcs.update(this.poses.shown, {
      eye,
      scale: this.scale,
      polar: rig.pose.polar,
      ceiling: this.aim.section ?? Infinity,
      selected,
    })
    if (this.scene.trails.lines.visible) {
      this.scene.trails.update(this.poses.shown, now / 1000)
    }
    this.scene.selection.update(selected === undefined ? undefined : this.poses.find(selected), eye, this.scale)
    this.scene.markers.scaleFor(eye, this.scale)
    this.scene.replay.update(eye, this.scale)
  }

  setQuick(quick: boolean): void {
    this.scene.setQuick(quick)
  }

  stillChanged(): void {
    this.aim.invalidate()
  }

  drawn(now: number): void {
    const { stage, rig, aim } = this
    const { width, height } = stage.size
    this.labels.draw({
      now,
      projector: aim.projector(),
      width,
      height,
      ratio: stage.fullRatio,
      centre: rig.pose.target,
      reach: rig.pose.distance < MOST_NAMED_M ? rig.pose.distance * 0.7 + NAMED_M : 0,
      ceiling: aim.section ?? Infinity,
      npc: (id) => this.poses.find(id),
      isHidden: (place) => this.scene.terrain.hides(stage.camera.position, place, aim.section),
    })
    this.clip?.take()
  }

  private get layers(): readonly HTMLCanvasElement[] {
    return [this.stage.canvas, this.labels.canvas]
  }

  private drawNow(): void {
    const now = performance.now()
    this.advance(now, 0)
    this.setQuick(false)
    this.stage.draw(false)
    this.drawn(now)
  }

  private stopFollowing(): void {
    if (this.rig.following !== undefined) {
      this.rig.follow(undefined)
      this.events.followingEnded?.()
    }
  }

  /** Chooses where to follow an NPC from. */
  private steer(npc: ShownNpc): void {
    const { rig } = this
    const { azimuth, polar } = rig.pose
    const at = { x: npc.x, y: npc.y + 0.8, z: npc.z }
    const { terrain } = this.scene
    const isFree = (angles: Angles): boolean =>
      !terrain.hides(at, lensOf(rig.chasePose(at, angles), 1).eye, this.aim.section)
    const present = { azimuth, polar }
    rig.steer(chaseAngles(npc, npc.goal, present, isFree), !isFree(present))
  }

  private resize(container: HTMLElement): void {
    this.stage.resize(container.clientWidth, container.clientHeight)
    this.frames.change()
  }

  private frameOnce(): void {
    if (!this.framed && this.rig.following === undefined) {
      this.frame(false)
    }
    this.framed = true
  }

  private frame(flight: boolean): void {
    const box = this.scene.box()
    const { width, height } = this.stage.size
    if (box) {
      this.rig.setExtent(box)
      this.rig.frame(box, width / height, flight)
      this.framed = true
    }
  }
}
