// All that the page knows and can do. The panels show it and the view draws it; neither is needed for it to work.

import { batch, computed, effect, signal, untracked } from '@preact/signals'
import type { Box, Viewport } from '../view/viewport.types'
import { Builds } from './build/builds'
import type { Context } from './context'
import { keepOpening } from './opening'
import { Layers } from './edit/layers'
import { Graphs } from './graph/graphs'
import { Probes } from './graph/probes'
import { legKey } from './plan/alternatives'
import { Plans } from './plan/plans'
import { Reach } from './plan/reach'
import { importAgain } from './reimport'
import { Tour, type TourFacts } from './tour'
import type { ViewLink } from './view-link'
import { ViewSettings } from './view-settings'
import { Levels } from './world/import'
import { Level } from './world/level'
import { Live } from './world/live'
import { Marks } from './world/marks'
import { Movers } from './world/movers'
import { Npcs } from './world/npcs'
import { Pieces } from './world/pieces'
import type { MotionFacts } from './world/motion'
import { nextChaser, OwnPlayer } from './world/player'
import { Recorder } from './world/recorder'
import { Replays } from './world/replays'
import { boxOnMap } from './world/report'
import { Surveys } from './world/surveys'
import { npcAfter } from './world/under-way'
import { type Site, Worlds } from './world/worlds'

/** What a click on the map does. */
export type Tool =
  | 'select'
  | 'plan'
  | 'forbid'
  | 'add'
  | 'move'
  | 'remove'
  | 'force'
  | 'spawn'
  | 'player'
  | 'reach'
  | 'send'
  | 'teleport'
  | 'mark'
  | 'build'

/** Tools that change the graph. */
export const EDIT_TOOLS: ReadonlySet<Tool> = new Set<Tool>(['forbid', 'add', 'move', 'remove', 'force'])

/** Tools that are put down when another world is shown. */
const WORLD_TOOLS: ReadonlySet<Tool> = new Set<Tool>(['mark', 'build', 'player'])

export type Tab = 'map' | 'report' | 'npcs' | 'graph' | 'plan' | 'layers' | 'build'

/** Top speed of the default body, for NPCs with an unknown one, m/s. */
const DEFAULT_SPEED_M_S = 11
/** A level is imported again once its sidecar has not changed for so long, ms. */
const SETTLED_MS = 500

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
  readonly player: OwnPlayer
  readonly graphs: Graphs
  readonly layers: Layers
  readonly plans: Plans
  readonly reach: Reach
  readonly builds: Builds
  readonly probes: Probes
  readonly view: ViewSettings
  readonly tour: Tour
  private readonly recorder = new Recorder()
  readonly replays: Replays

  readonly tool = signal<Tool>('select')
  readonly tab = signal<Tab>('map')
  readonly panelOpen = signal(true)
  readonly helpOpen = signal(false)
  /** First vertex of an edge that is being forced. */
  readonly forceFrom = signal<number | undefined>(undefined)
  /** Undefined until it stands, and where the browser cannot draw. */
  readonly viewport = signal<Viewport | undefined>(undefined)
  readonly viewportFailure = signal('')
  /** Whether the world that is shown has yet to open on an NPC under way. */
  readonly opening = signal(true)
  /** A link whose view is to be shown. */
  readonly link = signal<ViewLink | undefined>(undefined)
  /** Turns, moves and zooms of the camera by hand so far. */
  readonly looks = signal(0)
  /** The world that is shown, once it is known what lies on its map. */
  readonly site = computed<Site | undefined>(() => {
    const [world, laid] = [this.worlds.chosen.value, this.pieces.laid.value]
    if (world === undefined || laid === undefined || laid.worldId !== world.worldId) return undefined
    return { world, pieces: laid.pieces, mapHash: laid.mapHash || world.mapHash }
  })
  /** Whether the map that is shown is the imported level's. */
  readonly showsImported = computed(() => {
    const imported = this.levels.imported.value
    return imported !== undefined && imported.mapHash === this.worlds.chosen.value?.mapHash
  })
  /** The box of the selected node on the map that is shown. */
  readonly selectedBox = computed<Box | undefined>(() => {
    const { imported, selected } = this.levels
    const node = imported.value?.nodes.find(({ index }) => index === selected.value)
    const frame = this.showsImported.value ? imported.value?.frame : undefined
    return node && frame && boxOnMap(node, frame)
  })
  /** Whether the page is visible. Streams pause while it is hidden. */
  private readonly visible = signal(true)
  /** Aborts when another world is shown. */
  private shownWorld: AbortSignal | undefined

  constructor(readonly context: Context) {
    this.view = new ViewSettings(context.store)
    this.tour = new Tour(context.store)
    this.worlds = new Worlds(context)
    this.movers = new Movers(context)
    this.pieces = new Pieces(context, (box) => this.redraw(box))
    this.live = new Live(
      context,
      (tick, npc) => this.recorder.take(tick, npc),
      (states, isDelta) => this.movers.take(states, isDelta),
      (revision) => this.noteRevision(revision),
    )
    this.level = new Level(context)
    this.levels = new Levels(context)
    this.surveys = new Surveys(context)
    this.npcs = new Npcs(context)
    this.replays = new Replays(this.recorder, (npcId) => this.motionFacts(npcId))
    this.player = new OwnPlayer(context, () => this.setTool('select'))
    this.layers = new Layers(context, () => void this.graphs.reload())
    this.graphs = new Graphs(context, this.live.npcs, (graph) => this.layers.sync(graph))
    this.plans = new Plans(context, this.movers.given)
    this.reach = new Reach(context, this.plans.caution, this.movers.given)
    this.builds = new Builds(context, () => void this.graphs.refreshList())
    this.probes = new Probes(context, (track, reached, done) => {
      const viewport = this.viewport.peek()
      if (viewport === undefined) done()
      else viewport.playTrack(track, reached, done)
    })
  }

  /** Begins to talk to the services, and shows the view of a link if there is one. */
  start(link?: ViewLink): void {
    if (link !== undefined) this.openLink(link)
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
      untracked(() => {
        this.plans.useGraph(graphId)
        this.reach.useGraph(graphId)
      })
    })
    effect(() => {
      void this.movers.givenKey.value
      untracked(() => this.plans.replan())
    })
    effect(() => {
      void this.movers.givenKey.value
      void this.plans.caution.value
      untracked(() => this.reach.refresh())
    })
    effect(() => {
      void this.graphs.id.value
      // A vertex of another graph.
      this.forceFrom.value = undefined
    })
    effect(() => {
      const id = this.npcs.selectedId.value
      if (this.replays.shown.peek()?.npcId !== id) this.replays.close()
    })
    effect(() => {
      const { npcs, players } = this.live.moment.value
      const id = this.player.body.peek()?.playerId
      const player = players.find(({ playerId }) => playerId === id)
      untracked(() => this.npcs.noteChasers(npcs, player?.position))
    })
    effect(() => {
      // Each step begins with what is known then.
      void this.tour.at.value
      this.tour.take(this.facts())
    })
    effect(() => {
      if (this.level.state.value.kind === 'ready' && link === undefined) untracked(() => this.tour.offer())
    })
    effect(() => {
      const wanted = this.levels.unsent.value
      if (wanted === undefined) return undefined
      const timer = setTimeout(() => void importAgain(this, wanted), SETTLED_MS)
      return () => clearTimeout(timer)
    })
    keepOpening(this)
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
      if (tool !== 'player') this.removePlayer()
      if (tool !== 'reach') this.reach.clear()
      // What is clicked stands still.
      if (tool !== 'select') this.npcs.camera.value = false
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

  /** Shows the view of a link, on its world. */
  openLink(link: ViewLink): void {
    const { worlds } = this
    worlds.wanted = link.world
    batch(() => {
      this.link.value = link
      this.opening.value = true
      const isThere = worlds.list.value.some(({ worldId }) => worldId === link.world.id)
      if (isThere) worlds.choose(link.world.id)
    })
  }

  /** Brings out the edges of the graph, or makes them faint again. */
  toggleGraph(): void {
    const { graphs } = this
    graphs.setFilter({ presence: graphs.filter.peek().presence === 'full' ? 'faint' : 'full' })
  }

  /** Follows another NPC with the camera, one under way if there is any. */
  followAnother(): void {
    const next = npcAfter(this.live.moment.peek().npcs, this.npcs.selectedId.peek())
    if (next === undefined) return this.context.toasts.say('There is no NPC to follow.')
    this.npcs.goAlong(next.npcId)
  }

  /** Lets an NPC chase the player: this one, or the selected one, or the nearest one that does not do so yet. */
  chasePlayer(npcId?: bigint): void {
    const { npcs, player } = this
    const [at, body] = [player.at.peek(), player.body.peek()]
    if (at === undefined || body === undefined) return
    const { npcs: all } = this.live.moment.peek()
    const chaser = npcId ?? nextChaser(all, npcs.selectedId.peek(), at, npcs.chasers.peek())?.npcId
    if (chaser === undefined) return this.context.toasts.say('There is no NPC left to chase the player.')
    void npcs.chase(chaser, body.playerId).then(() => {
      if (player.body.peek() !== body) void npcs.stopChase([chaser])
    })
  }

  /** Removes the player. NPCs that chase it are free for other goals. */
  removePlayer(): void {
    void this.npcs.stopChase([...this.npcs.chasers.peek().keys()])
    this.player.remove()
  }

  /** Replays the last attempt of the selected NPC, or ends the replay. */
  toggleReplay(): void {
    if (this.replays.shown.peek() !== undefined) return this.replays.close()
    if (this.npcs.selectedId.peek() === undefined) return this.context.toasts.say('Select an NPC first.')
    if (!this.openReplay()) this.context.toasts.say('No attempt of this NPC has been received yet.')
  }

  /** Shows or hides the plots of a replay. Where there is a recording, its replay begins. */
  togglePlots(): void {
    const { view, replays } = this
    view.setPlots(!view.plots.peek())
    if (view.plots.peek() && replays.shown.peek() === undefined) this.openReplay()
  }

  private openReplay(): boolean {
    const [followed, selected] = [this.npcs.followed.peek(), this.npcs.selectedId.peek()]
    if (followed?.npc === undefined || followed.id !== selected) return false
    return this.replays.open(followed.id, followed.npc.attemptsBegun, followed.history)
  }

  /** What is known of an NPC's body, and of the graph that is shown. */
  private motionFacts(npcId: bigint): MotionFacts {
    const { bodies = [] } = this.worlds.chosen.peek() ?? {}
    const body = bodies[this.live.npc(npcId)?.bodyIdx ?? 0]
    return {
      topSpeed: body?.forwardSpeed ?? DEFAULT_SPEED_M_S,
      abilityBetween: (from, to) => this.graphs.edgeBetween(from, to)?.ability,
    }
  }

  /** Selects a node of the imported level, and shows it from near by. */
  selectNode(index: number): void {
    this.levels.selected.value = index
    const box = this.selectedBox.peek()
    if (box === undefined) return
    if (this.link.peek() === undefined) this.opening.value = false
    this.viewport.peek()?.frameBox(box)
  }

  openTab(tab: Tab): void {
    batch(() => {
      this.tab.value = tab
      this.panelOpen.value = true
    })
  }

  /** What the tour notices. */
  private facts(): TourFacts {
    const plan = this.plans.chosen.value
    const edits = this.layers.list.value.flatMap(({ edits }) => edits)
    return {
      looks: this.looks.value,
      follows: this.npcs.camera.value ? this.npcs.selectedId.value : undefined,
      plan: plan?.found === true ? legKey(plan) : undefined,
      sent: this.npcs.sent.value,
      forbidden: edits.filter(({ edit }) => edit.case === 'forbidEdge').length,
    }
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
      this.reach.clear()
      this.probes.forget()
      this.builds.clearComparison()
      this.npcs.select(undefined)
      this.replays.close()
      this.recorder.forget()
      this.opening.value = true
      this.marks.clear()
      this.surveys.shown.value = undefined
      this.removePlayer()
      if (WORLD_TOOLS.has(this.tool.value)) this.tool.value = 'select'
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
