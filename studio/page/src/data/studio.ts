// All that the page knows and can do. The panels show it and the view draws it; neither is needed for it to work.

import { batch, computed, effect, signal, untracked } from '@preact/signals'
import type { Viewport } from '../view/viewport.types'
import { Builds } from './build/builds'
import type { Context } from './context'
import { Layers } from './edit/layers'
import { Graphs } from './graph/graphs'
import { Probes } from './graph/probes'
import { Plans } from './plan/plans'
import { ViewSettings } from './view-settings'
import { Levels } from './world/import'
import { Level } from './world/level'
import { Live } from './world/live'
import { Marks } from './world/marks'
import { Movers } from './world/movers'
import { Npcs } from './world/npcs'
import { type Box, Pieces } from './world/pieces'
import { Surveys } from './world/surveys'
import { type Site, Worlds } from './world/worlds'

/** What a click on the map does. */
export type Tool =
  'select' | 'plan' | 'forbid' | 'add' | 'move' | 'remove' | 'force' | 'spawn' | 'send' | 'teleport' | 'mark' | 'build'

/** Tools that change the graph. */
export const EDIT_TOOLS: ReadonlySet<Tool> = new Set<Tool>(['forbid', 'add', 'move', 'remove', 'force'])

export type Tab = 'map' | 'npcs' | 'graph' | 'plan' | 'layers' | 'build'

export class Studio {
  readonly worlds: Worlds
  readonly live: Live
  readonly level: Level
  readonly levels: Levels
  readonly marks = new Marks()
  readonly surveys: Surveys
  readonly movers: Movers
  readonly pieces: Pieces
  readonly npcs: Npcs
  readonly graphs: Graphs
  readonly layers: Layers
  readonly plans: Plans
  readonly builds: Builds
  readonly probes: Probes
  readonly view: ViewSettings

  readonly tool = signal<Tool>('select')
  readonly tab = signal<Tab>('map')
  readonly panelOpen = signal(true)
  readonly helpOpen = signal(false)
  /** First vertex of an edge that is being forced. */
  readonly forceFrom = signal<number | undefined>(undefined)
  /** Undefined until it stands, and where the browser cannot draw. */
  readonly viewport = signal<Viewport | undefined>(undefined)
  readonly viewportFailure = signal('')
  /** The world that is shown, once it is known what lies on its map. */
  readonly site = computed<Site | undefined>(() => {
    const [world, laid] = [this.worlds.chosen.value, this.pieces.laid.value]
    if (world === undefined || laid === undefined || laid.worldId !== world.worldId) return undefined
    return { world, pieces: laid.pieces, mapHash: laid.mapHash || world.mapHash }
  })
  /** Whether the page is visible. Streams pause while it is hidden. */
  private readonly visible = signal(true)
  /** Aborts when another world is shown. */
  private shownWorld: AbortSignal | undefined

  constructor(readonly context: Context) {
    this.view = new ViewSettings(context.store)
    this.worlds = new Worlds(context)
    this.movers = new Movers(context)
    this.pieces = new Pieces(context, (box) => this.redraw(box))
    this.live = new Live(
      context,
      (states, isDelta) => this.movers.take(states, isDelta),
      (revision) => this.noteRevision(revision),
    )
    this.level = new Level(context)
    this.levels = new Levels(context)
    this.surveys = new Surveys(context)
    this.npcs = new Npcs(context)
    this.layers = new Layers(context, () => void this.graphs.reload())
    this.graphs = new Graphs(context, this.live.npcs, (graph) => this.layers.sync(graph))
    this.plans = new Plans(context, this.movers.given)
    this.builds = new Builds(context, () => void this.graphs.refreshList())
    this.probes = new Probes(context, (track, reached, done) => {
      const viewport = this.viewport.peek()
      if (viewport === undefined) done()
      else viewport.playTrack(track, reached, done)
    })
  }

  /** Begins to talk to the services. */
  start(): void {
    void this.worlds.poll()
    void this.graphs.poll()
    const worldKey = this.worlds.key
    const worldId = computed(() => (worldKey.value === undefined ? undefined : this.worlds.chosenId.value))
    // First, so that what belongs to the world before is forgotten before anything of the next one comes.
    whileGiven(
      () => worldKey.value,
      (_, signal) => signal.addEventListener('abort', () => this.leaveWorld(), { once: true }),
    )
    whileGiven(
      () => worldKey.value,
      (_, signal) => {
        this.shownWorld = signal
        withId(worldId.peek(), (id) => this.pieces.load(id, signal))
      },
    )
    // The world's key as well: other worlds have equal maps.
    whileGiven(
      () => (this.site.value === undefined ? undefined : `${worldKey.value} ${this.site.value.mapHash}`),
      (_, signal) => {
        const site = this.site.peek()
        if (site !== undefined) void this.graphs.keep(site, signal)
      },
    )
    whileGiven(
      () => (this.visible.value ? worldKey.value : undefined),
      (_, signal) => withId(worldId.peek(), (id) => this.live.watch(id, signal)),
    )
    whileGiven(
      () => worldKey.value,
      (_, signal) => withId(worldId.peek(), (id) => this.movers.load(id, signal)),
    )
    whileGiven(
      () => (this.viewport.value === undefined ? undefined : worldKey.value),
      (_, signal) => {
        const viewport = this.viewport.peek()
        if (viewport !== undefined) withId(worldId.peek(), (id) => this.level.load(id, viewport, signal))
      },
    )
    whileGiven(
      () => (this.visible.value ? this.npcs.selectedId.value : undefined),
      (id, signal) => void this.npcs.follow(id, signal),
    )
    effect(() => {
      const graphId = this.graphs.loaded.value === undefined ? undefined : this.graphs.id.value
      untracked(() => this.plans.useGraph(graphId))
    })
    effect(() => {
      void this.movers.givenKey.value
      untracked(() => this.plans.replan())
    })
    effect(() => {
      void this.graphs.id.value
      // A vertex of another graph.
      this.forceFrom.value = undefined
    })
    effect(() => {
      if (this.layers.conflict.value !== undefined) untracked(() => this.openTab('layers'))
    })
  }

  /** Sets whether the page is visible. */
  setVisible(visible: boolean): void {
    this.visible.value = visible
  }

  setTool(tool: Tool): void {
    batch(() => {
      this.tool.value = tool
      this.forceFrom.value = undefined
      this.marks.begun.value = undefined
      this.pieces.begun.value = undefined
      if (tool === 'plan') this.openTab('plan')
      if (tool === 'mark' || tool === 'build') this.openTab('map')
      if (tool === 'mark') {
        // It would hide what is marked.
        this.graphs.setFilter({ presence: 'off' })
      }
      // What is changed should be seen.
      if (EDIT_TOOLS.has(tool)) this.graphs.setFilter({ presence: 'full' })
    })
  }

  openTab(tab: Tab): void {
    batch(() => {
      this.tab.value = tab
      this.panelOpen.value = true
    })
  }

  /** The map of the world that is shown has this revision. */
  private noteRevision(revision: bigint): void {
    const [id, signal] = [this.worlds.chosenId.peek(), this.shownWorld]
    if (id !== undefined && signal !== undefined) void this.pieces.take(id, revision, signal)
  }

  /** Redraws the map where it was edited. */
  private redraw(box: Box): void {
    const [id, viewport, signal] = [this.worlds.chosenId.peek(), this.viewport.peek(), this.shownWorld]
    if (id !== undefined && viewport !== undefined && signal !== undefined)
      void this.level.redraw(id, viewport, box, signal)
  }

  /** What belongs to a world goes with it. */
  private leaveWorld(): void {
    batch(() => {
      this.live.forget()
      this.movers.forget()
      this.pieces.forget()
      this.level.forget()
      this.graphs.forget()
      this.layers.forget()
      this.plans.clear()
      this.probes.forget()
      this.builds.clearComparison()
      this.npcs.select(undefined)
      this.marks.clear()
      this.surveys.shown.value = undefined
      if (this.tool.value === 'mark' || this.tool.value === 'build') this.tool.value = 'select'
      this.forceFrom.value = undefined
    })
  }
}

/** Runs `work` for each new value that `given` has, and aborts its signal when it has another one. */
function whileGiven<T>(given: () => T | undefined, work: (value: T, signal: AbortSignal) => void): void {
  const value = computed(given)
  effect(() => {
    const now = value.value
    if (now === undefined) return undefined
    const running = new AbortController()
    untracked(() => work(now, running.signal))
    return () => running.abort()
  })
}

function withId(id: bigint | undefined, work: (id: bigint) => Promise<void>): void {
  if (id !== undefined) void work(id)
}
