// The navigation graph over the ground: dots, lines with arrowheads, and what of it is selected.

import { Group } from 'three'
import { edgeColour, isEdited, LIFT_M, pointAlong, secondsRange, type ShapedEdge, shapeEdges } from './edge-shape'
import { islandColour, MARK_COLOURS, parseColour, type Rgb } from './colours'
import type { Materials } from './materials'
import { ArrowBatch, LineBatch, SpriteBatch } from './overlays'
import type { Palette } from './theme'
import type { Graph, GraphFilter, Place, Traffic } from './viewport.types'

const TRAP = parseColour('#ff3045')
const SELECTED = parseColour(MARK_COLOURS.selected)
export const VERTEX_M = 0.8
/** Opacity of a faint graph. */
const FAINT = 0.12

const lifted = (place: Place): Place => ({ ...place, y: place.y + LIFT_M })

export class GraphView extends Group {
  graph: Graph | undefined
  filter: GraphFilter | undefined
  edges: readonly ShapedEdge[] = []
  private traffic: Traffic = new Map()
  private vertex: number | undefined
  private edge: { from: number; to: number } | undefined
  private readonly faint: LineBatch
  private readonly lines: LineBatch
  private readonly dashes: LineBatch
  private readonly arrows: ArrowBatch
  private readonly dots: SpriteBatch
  private readonly marks: { lines: LineBatch; dots: SpriteBatch; arrows: ArrowBatch }

  constructor(
    materials: Materials,
    private palette: Palette,
  ) {
    super()
    this.faint = new LineBatch(materials, 'softLines', 9)
    this.lines = new LineBatch(materials)
    this.dashes = new LineBatch(materials, 'dashes')
    this.arrows = new ArrowBatch(materials)
    this.dots = new SpriteBatch(materials)
    this.marks = {
      lines: new LineBatch(materials, 'lines', 13),
      arrows: new ArrowBatch(materials, 14),
      dots: new SpriteBatch(materials, 15),
    }
    this.add(...this.batches)
  }

  setGraph(graph: Graph | undefined): void {
    this.graph = graph
    this.rebuild()
  }

  setFilter(filter: GraphFilter): void {
    this.filter = filter
    this.rebuild()
  }

  /** Whether anything is drawn otherwise now. */
  setTraffic(traffic: Traffic): boolean {
    this.traffic = traffic
    const shows = this.graph !== undefined && this.filter?.colour === 'traffic'
    if (shows) this.rebuild()
    return shows
  }

  setPalette(palette: Palette): void {
    this.palette = palette
    this.rebuild()
  }

  select(vertex: number | undefined, edge: { from: number; to: number } | undefined): void {
    this.vertex = vertex
    this.edge = edge
    this.rebuildMarks()
  }

  get selection(): { vertex: number | undefined; edge: { from: number; to: number } | undefined } {
    return { vertex: this.vertex, edge: this.edge }
  }

  get showsVertices(): boolean {
    return this.graph !== undefined && this.filter !== undefined && this.filter.presence !== 'off'
  }

  override dispose(): void {
    this.batches.forEach((batch) => batch.dispose())
  }

  private get batches(): (LineBatch | ArrowBatch | SpriteBatch)[] {
    return [this.faint, this.lines, this.dashes, this.arrows, this.dots, ...Object.values(this.marks)]
  }

  private rebuild(): void {
    const { graph, filter } = this
    this.edges = graph && filter ? shapeEdges(graph, filter) : []
    if (graph && filter) {
      this.addEdges(graph, filter)
      this.addVertices(graph, filter)
    }
    for (const batch of [this.faint, this.lines, this.dashes, this.arrows, this.dots]) {
      batch.commit()
    }
    this.rebuildMarks()
  }

  private addEdges(graph: Graph, filter: GraphFilter): void {
    const range = secondsRange(graph)
    for (const { edge, points } of this.edges) {
      if (filter.presence === 'faint' && !isEdited(edge)) {
        this.faint.polyline(points, { colour: this.palette.vertex, width: 1.2, opacity: FAINT })
        continue
      }
      const npcs = this.traffic.get(`${edge.from}>${edge.to}`) ?? 0
      const colour = edgeColour(edge, graph, filter.colour, { ...range, npcs })
      if (filter.colour === 'traffic' && npcs > 0) {
        this.lines.polyline(points, { colour, width: 2 + Math.min(npcs, 8) / 2 })
      } else if (edge.forced) {
        this.dashes.polyline(points, { colour, width: 3.2, dash: 1.6 })
      } else {
        this.lines.polyline(points, { colour, width: isEdited(edge) ? 3.4 : 1.5 })
      }
      const { at, towards } = pointAlong(points, 0.6)
      this.arrows.arrow(at, towards, colour)
    }
  }

  private addVertices(graph: Graph, filter: GraphFilter): void {
    if (filter.presence === 'off') {
      return
    }
    const look =
      filter.presence === 'full'
        ? { size: VERTEX_M, least: 4, most: 15 }
        : { size: VERTEX_M / 2, least: 2, most: 5, opacity: 2 * FAINT }
    for (const { position, island, trap, removed } of graph.vertices) {
      if (removed) {
        continue
      }
      const at = lifted(position)
      const colour: Rgb = trap ? TRAP : filter.colour === 'island' ? islandColour(island) : this.palette.vertex
      this.dots.sprite(at, { colour, shape: 'disc', ...look })
      if (trap) {
        this.dots.sprite(at, { colour: TRAP, shape: 'ring', size: VERTEX_M * 2.2, least: 12, most: 30 })
      }
    }
  }

  private rebuildMarks(): void {
    const { lines, arrows, dots } = this.marks
    const vertices = this.showsVertices ? this.graph?.vertices : undefined
    const vertex = this.vertex === undefined ? undefined : vertices?.[this.vertex]
    if (vertex) {
      this.markEdgesOf(this.vertex!)
      dots.sprite(lifted(vertex.position), {
        colour: SELECTED,
        shape: 'ring',
        size: VERTEX_M * 2.6,
        least: 20,
        most: 40,
      })
    }
    const { edge } = this
    const shaped = edge && this.edges.find((it) => it.edge.from === edge.from && it.edge.to === edge.to)
    if (shaped) {
      lines.polyline(shaped.points, { colour: SELECTED, width: 5 })
      const { at, towards } = pointAlong(shaped.points, 0.6)
      arrows.arrow(at, towards, SELECTED)
      for (const end of [shaped.edge.from, shaped.edge.to]) {
        dots.sprite(lifted(vertices![end]!.position), {
          colour: SELECTED,
          shape: 'ring',
          size: VERTEX_M * 1.8,
          least: 14,
          most: 26,
        })
      }
    }
    lines.commit()
    arrows.commit()
    dots.commit()
  }

  /** The edges that begin or end at the selected vertex stand out. */
  private markEdgesOf(vertex: number): void {
    const { graph, filter } = this
    if (!graph || !filter) {
      return
    }
    const range = { ...secondsRange(graph), npcs: 0 }
    for (const { edge, points } of this.edges) {
      if (edge.from === vertex || edge.to === vertex) {
        const colour = edgeColour(edge, graph, filter.colour === 'traffic' ? 'chance' : filter.colour, range)
        this.marks.lines.polyline(points, { colour, width: 3 })
        const { at, towards } = pointAlong(points, 0.6)
        this.marks.arrows.arrow(at, towards, colour)
      }
    }
  }
}
