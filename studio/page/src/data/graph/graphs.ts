// The graph of the world that is shown: found or built, loaded, and kept up to date.

import { Code, ConnectError } from '@connectrpc/connect'
import { batch, computed, type ReadonlySignal, signal } from '@preact/signals'
import type { Build, GetGraphResponse, GraphSummary, ReadyGraph } from '../../gen/surefoot/planner/v1/planner_pb'
import type { Graph, GraphFilter, Place, Traffic } from '../../view/viewport.types'
import type { Context } from '../context'
import { pauseAfter, sleep } from '../net/backoff'
import { failureOf, inWords } from '../net/errors'
import { keepAsking, keepDoing, keepReading } from '../net/stream'
import type { NpcsById } from '../world/snapshot'
import type { Site } from '../world/worlds'
import { buildGraph } from './build-stream'
import { SHOW_ALL } from './filter'
import { graphToShow, islandsOf } from './islands'
import { newsOf } from './news'
import { TrafficCounter } from './traffic'

const NO_TRAFFIC: Traffic = new Map()
const LIST_MS = 5000
/** A planner keeps far fewer graphs than this. */
const PAGE = 1000
const TIMEOUT_MS = 8000
/** What NPCs report changes figures all the time: the graph is loaded again for it no more often than this. */
const LEARNED_MS = 10_000
/** The planner says every 20 s how a graph is. */
const IDLE_MS = 45_000
/** A build that fails within the planner would fail again, at some cost. */
const BROKEN_MS = 60_000
const PATIENCE = { breakdowns: 3 }
/** A waypoint nearer to a vertex than this is that vertex, m. */
const SAME_M = 0.3

export type GraphState =
  | { kind: 'none' }
  | { kind: 'searching' }
  | { kind: 'building'; progress: Build }
  | { kind: 'loading' }
  | { kind: 'ready' }
  | { kind: 'failed'; why: string }

export type Selection = { kind: 'edge'; from: number; to: number } | { kind: 'vertex'; index: number }

function isSame(a: Place | undefined, b: Place | undefined): boolean {
  return a !== undefined && b !== undefined && Math.hypot(a.x - b.x, a.y - b.y, a.z - b.z) < SAME_M
}

export class Graphs {
  readonly state = signal<GraphState>({ kind: 'none' })
  readonly id = signal<string | undefined>(undefined)
  readonly loaded = signal<GetGraphResponse | undefined>(undefined)
  readonly summary = signal<GraphSummary | undefined>(undefined)
  /** Graphs that the planner has ready. */
  readonly list = signal<readonly ReadyGraph[]>([])
  readonly filter = signal<GraphFilter>(SHOW_ALL)
  readonly selection = signal<Selection | undefined>(undefined)

  readonly islands = computed(() => {
    const graph = this.loaded.value
    return graph === undefined ? [] : islandsOf(graph.islands, graph.edges, graph.removed)
  })
  readonly traps = computed(() => this.islands.value.filter(({ standing }) => standing === 'trap'))
  readonly shown = computed<Graph | undefined>(() => {
    const graph = this.loaded.value
    return graph === undefined ? undefined : graphToShow(graph, this.islands.value)
  })
  private readonly counter = computed(() => {
    const graph = this.shown.value
    return graph === undefined || this.filter.value.colour !== 'traffic' ? undefined : new TrafficCounter(graph)
  })
  /** NPCs on each edge, while edges are coloured by it. */
  readonly traffic = computed<Traffic>(() => this.counter.value?.count(this.npcs.value.values()) ?? NO_TRAFFIC)
  /** Edges by "from>to". */
  private readonly edges = computed(
    () => new Map((this.loaded.value?.edges ?? []).map((edge) => [`${edge.from}>${edge.to}`, edge])),
  )
  private chosen: { mapHash: string; graphId: string } | undefined
  private changed: (() => void) | undefined
  /** Aborts when another graph is shown. */
  private following: AbortSignal | undefined
  private loads = 0
  private lastLoaded = 0

  constructor(
    private readonly context: Context,
    private readonly npcs: ReadonlySignal<NpcsById>,
    /** Called when a graph has been loaded, with the revision of the layers that lie over it. */
    private readonly onRevision: (graph: { id: string; revision: bigint; mapHash: string }) => void,
  ) {}

  edge(from: number, to: number) {
    return this.edges.value.get(`${from}>${to}`)
  }

  position(vertex: number) {
    return this.loaded.value?.vertices[vertex]
  }

  /** The edge between two places of a plan; undefined: they are not on the graph, or have no edge any more. */
  edgeBetween(from: Place | undefined, to: Place | undefined) {
    const [start, end] = [this.vertexAt(from), this.vertexAt(to)]
    return start === undefined || end === undefined ? undefined : this.edge(start, end)
  }

  /** Whether an edge leads from one of these places to the other. */
  isBetween({ from, to }: { from: number; to: number }, start: Place | undefined, end: Place | undefined): boolean {
    return isSame(this.position(from), start) && isSame(this.position(to), end)
  }

  private vertexAt(place: Place | undefined): number | undefined {
    const index = this.loaded.value?.vertices.findIndex((vertex) => isSame(vertex, place)) ?? -1
    return index < 0 ? undefined : index
  }

  setFilter(change: Partial<GraphFilter>): void {
    this.filter.value = { ...this.filter.value, ...change }
  }

  select(selection: Selection | undefined): void {
    this.selection.value = selection
  }

  /** Shows another graph of a world's map from now on. */
  show(mapHash: string, graphId: string): void {
    this.chosen = { mapHash, graphId }
    this.changed?.()
  }

  /** Keeps the list of graphs up to date, which also tells whether the planner is there. */
  async poll(): Promise<void> {
    const { signal, planner } = this.context
    while (!signal.aborted) {
      try {
        const upkeep = { link: planner.link, session: planner.session, signal }
        const options = { signal, timeoutMs: TIMEOUT_MS }
        const answer = await keepAsking(upkeep, () => planner.calls.listGraphs({ pageSize: PAGE }, options))
        if (answer !== undefined) this.list.value = answer.graphs
      } catch {
        // Too old a planner, or a role that may not: the list stays empty, which the panels say.
      }
      await sleep(LIST_MS, signal)
    }
  }

  async refreshList(): Promise<void> {
    try {
      this.list.value = (
        await this.context.planner.calls.listGraphs({ pageSize: PAGE }, { timeoutMs: TIMEOUT_MS })
      ).graphs
    } catch {
      // The next poll gets it.
    }
  }

  /** Keeps the graph of a world up to date until the signal aborts. */
  async keep(site: Site, signal: AbortSignal): Promise<void> {
    let failures = 0
    while (!signal.aborted) {
      const turn = new AbortController()
      this.changed = () => turn.abort()
      const both = AbortSignal.any([signal, turn.signal])
      this.state.value = { kind: 'searching' }
      try {
        const graphId = await this.find(site, both)
        if (graphId !== undefined) await this.follow(graphId, both)
        failures = 0
      } catch (error) {
        failures += 1
        if (this.chosen !== undefined && failureOf(error) === 'missing') this.chosen = undefined
        if (!both.aborted) this.state.value = { kind: 'failed', why: inWords(error) }
        if (ConnectError.from(error).code === Code.Internal) await sleep(BROKEN_MS, both)
      }
      if (!both.aborted) await sleep(pauseAfter(failures + 3), both)
    }
  }

  forget(): void {
    batch(() => {
      this.state.value = { kind: 'none' }
      this.id.value = undefined
      this.loaded.value = undefined
      this.summary.value = undefined
      this.selection.value = undefined
    })
  }

  /** The graph that was chosen for this map, else the one used last (by workers, as a rule), else the default one. */
  private async find(site: Site, signal: AbortSignal): Promise<string | undefined> {
    if (this.chosen?.mapHash === site.mapHash) return this.chosen.graphId
    const { planner } = this.context
    const upkeep = { link: planner.link, session: planner.session, signal }
    try {
      const answer = await keepAsking(upkeep, () =>
        planner.calls.listGraphs({ pageSize: PAGE }, { signal, timeoutMs: TIMEOUT_MS }),
      )
      this.list.value = answer?.graphs ?? []
      const ready = answer?.graphs.find(({ summary }) => summary?.mapHash === site.mapHash)
      if (ready !== undefined) return ready.graphId
    } catch (error) {
      if (failureOf(error) !== 'unsupported') throw error
    }
    return this.build(site, signal)
  }

  private async build(site: Site, signal: AbortSignal): Promise<string | undefined> {
    const { planner } = this.context
    const stop = new AbortController()
    const upkeep = { link: planner.link, session: planner.session, signal: AbortSignal.any([signal, stop.signal]) }
    let graphId: string | undefined
    const error = await keepDoing(
      upkeep,
      async (gotSomething) => {
        for await (const progress of buildGraph(this.context, site, undefined, signal)) {
          gotSomething()
          this.state.value = { kind: 'building', progress }
          if (progress.summary !== undefined) graphId = progress.graphId
          if (progress.interimGraphId !== '') {
            // The build goes on, and what it finds out is shown as it comes.
            graphId = progress.interimGraphId
            break
          }
        }
        if (graphId !== undefined) stop.abort()
      },
      PATIENCE,
    )
    if (error !== undefined) throw error
    return graphId
  }

  private async follow(graphId: string, signal: AbortSignal): Promise<void> {
    batch(() => {
      this.state.value = { kind: 'loading' }
      this.selection.value = undefined
    })
    const { planner } = this.context
    this.following = signal
    await this.load(graphId, signal)
    let lastLoad = performance.now()
    let waiting: ReturnType<typeof setTimeout> | undefined
    const reload = () => {
      waiting = undefined
      lastLoad = performance.now()
      this.load(graphId, signal).catch(() => undefined)
    }
    const error = await keepReading(
      { link: planner.link, session: planner.session, signal },
      (signal) => planner.calls.watchGraph({ graphId }, { signal }),
      ({ summary, revision }) => {
        this.summary.value = summary ?? this.summary.value
        const news = newsOf(this.loaded.peek(), summary, revision)
        if (news === 'other graph') {
          clearTimeout(waiting)
          reload()
        } else if (news === 'other figures') {
          waiting ??= setTimeout(reload, Math.max(0, LEARNED_MS - (performance.now() - lastLoad)))
        }
      },
      IDLE_MS,
    )
    clearTimeout(waiting)
    if (error === undefined) return
    if (failureOf(error) !== 'unsupported') throw error
    // An older planner does not report changes, so the loaded graph is shown.
    await new Promise((resolve) => signal.addEventListener('abort', resolve, { once: true }))
  }

  /** Loads a graph, again after it has changed. */
  private async load(graphId: string, signal: AbortSignal): Promise<void> {
    const { planner } = this.context
    const upkeep = { link: planner.link, session: planner.session, signal }
    const turn = ++this.loads
    const graph = await keepAsking(upkeep, (signal) => planner.calls.getGraph({ graphId }, { signal }))
    // One that was asked for later may have come first.
    if (graph === undefined || signal.aborted || turn < this.lastLoaded) return
    this.lastLoaded = turn
    batch(() => {
      this.id.value = graphId
      this.loaded.value = graph
      this.summary.value = graph.summary
      this.state.value = { kind: 'ready' }
      this.dropStaleSelection()
    })
    this.onRevision({ id: graphId, revision: graph.revision, mapHash: graph.summary?.mapHash ?? '' })
  }

  /** Loads the graph again at once, because this page has changed it. */
  async reload(): Promise<void> {
    const graphId = this.id.peek()
    if (graphId === undefined || this.following === undefined) return
    await this.load(graphId, this.following).catch(() => undefined)
  }

  private dropStaleSelection(): void {
    const selection = this.selection.peek()
    if (selection?.kind === 'edge' && this.edge(selection.from, selection.to) === undefined) this.select(undefined)
    if (selection?.kind === 'vertex' && this.position(selection.index) === undefined) this.select(undefined)
  }
}
