// Everything that can be seen: owns the drawn parts and the materials that they share.

import { FeatureView } from './features'
import { GraphView } from './graph-view'
import { Materials } from './materials'
import { MoverView } from './movers'
import { NpcView } from './npcs'
import { OutlineView } from './outline'
import { setSeeThrough } from './overlays'
import { ReachView } from './reach-view'
import { MarkerView, MarkView, PathView } from './routes'
import { SelectionView } from './selection'
import type { Stage } from './stage'
import { Terrain } from './terrain'
import { paletteOf } from './theme'
import { ReplayView, TrackView } from './track'
import { Trails } from './trails'
import { VertexDrag } from './vertex-drag'
import type { Box, Theme } from './viewport.types'

export class Scene {
  readonly materials = new Materials()
  private readonly palette = paletteOf({ dark: true })
  readonly terrain = new Terrain(this.materials, this.palette)
  readonly features = new FeatureView(this.materials, this.palette)
  readonly graph = new GraphView(this.materials, this.palette)
  readonly paths = new PathView(this.materials)
  readonly markers = new MarkerView(this.materials)
  readonly reach = new ReachView(this.materials, (ray) => this.terrain.cast(ray, undefined)?.distance)
  readonly marks = new MarkView(this.materials)
  readonly outline = new OutlineView(this.materials)
  readonly movers = new MoverView(this.materials)
  readonly npcs = new NpcView(this.materials)
  readonly trails = new Trails(this.materials)
  readonly selection = new SelectionView(this.materials)
  readonly track = new TrackView(this.materials)
  readonly replay = new ReplayView(this.materials)
  readonly drag = new VertexDrag(this.materials)

  constructor(private readonly stage: Stage) {
    const { terrain, features, reach, graph, paths, markers, marks, outline } = this
    stage.still.add(terrain, features, reach, graph, paths, markers, marks, outline)
    stage.moving.add(this.movers, this.trails.lines, this.npcs, this.selection, this.track, this.replay, this.drag)
  }

  /** Takes away the map and all that is drawn on it. */
  clear(): void {
    this.terrain.clearTiles()
    this.features.set(undefined)
    this.movers.set([])
    this.movers.setPlayers([])
    this.graph.setGraph(undefined)
    this.graph.select(undefined, undefined)
    this.paths.set([])
    this.markers.set({ start: undefined, goal: undefined, nearest: undefined })
    this.reach.set(undefined)
    this.marks.setEdits([])
    this.marks.setDifference([], [])
    this.outline.set(undefined)
    this.trails.clear()
    this.selection.set(undefined)
    this.track.stop()
    this.replay.set(undefined)
    this.drag.end()
  }

  setTheme(theme: Theme): void {
    const palette = paletteOf(theme)
    this.materials.setPalette(palette)
    this.stage.setBackground(palette.background)
    this.terrain.setPalette(palette)
    this.features.setPalette(palette)
    this.graph.setPalette(palette)
  }

  setSection(height: number | undefined): void {
    this.materials.setSection(height)
    this.terrain.setSection(height !== undefined)
  }

  /** Leaves out what can be missed while the camera moves, or shows it again. */
  setQuick(quick: boolean): void {
    this.terrain.setQuick(quick, this.stage.camera)
    setSeeThrough(this.stage.still, !quick)
    setSeeThrough(this.stage.moving, !quick)
  }

  /** The space that the map takes; undefined while there is no map. */
  box(): Box | undefined {
    const { size } = this.features
    const features = size && { low: { x: 0, y: 0, z: 0 }, high: { x: size.width, y: size.height * 0.6, z: size.depth } }
    return this.terrain.box() ?? features
  }

  dispose(): void {
    this.terrain.clearTiles()
    for (const part of [
      this.features,
      this.graph,
      this.paths,
      this.markers,
      this.reach,
      this.marks,
      this.outline,
      this.movers,
      this.npcs,
      this.trails,
    ]) {
      part.dispose()
    }
    this.selection.dispose()
    this.track.dispose()
    this.replay.dispose()
    this.drag.dispose()
    this.materials.dispose()
  }
}
