// What a click on the map does, tool by tool.

import { addVertex, forbidEdge, forceEdge, moveVertex, removeVertex } from '../data/edit/edits'
import { onClick } from '../data/world/movers'
import { npcNumber } from '../data/world/snapshot'
import { EDIT_TOOLS, type Studio, type Tool } from '../data/studio'
import type { MarkKind } from '../data/world/marks'
import type { PieceKind } from '../data/world/pieces'
import type { Hit, Place } from '../view/viewport.types'

/** What to do next with a tool, in a few words. */
export function hintFor(studio: Studio): string {
  const npc = studio.npcs.selectedId.value
  const named = npc === undefined ? 'the NPC' : `NPC ${npcNumber(npc)}`
  const hints: Record<Tool, string> = {
    select: '',
    plan: studio.plans.next.value === 'start' ? 'Click where to start' : 'Click where to go',
    forbid: 'Click an edge to forbid it',
    add: 'Click the ground to add a vertex',
    move: 'Drag a vertex',
    remove: 'Click a vertex to remove it',
    force: studio.forceFrom.value === undefined ? 'Click the start of the edge' : 'Click the end of the edge',
    spawn: 'Click where to spawn the NPC',
    player: studio.player.isThere.value
      ? 'Walk with W A S D or clicks, run with Shift, leave with Esc'
      : 'Click where to put the player',
    reach: studio.reach.start.value === undefined ? 'Click where to start' : 'Click another start, or leave with Esc',
    send: `Click where to send ${named}`,
    teleport: `Click where to teleport ${named}`,
    mark: markHint(studio),
    build: buildHint(studio),
  }
  return hints[studio.tool.value]
}

function buildHint({ pieces }: Studio): string {
  const hints: Record<PieceKind, readonly [first: string, second: string]> = {
    block: ['Click where to put the block', ''],
    bridge: ['Click the start of the bridge', 'Click its end'],
    lava: ['Click a corner of the lava', 'Click the opposite corner'],
    water: ['Click a corner of the water', 'Click the opposite corner'],
  }
  return hints[pieces.kind.value][pieces.begun.value === undefined ? 0 : 1]
}

function markHint({ marks }: Studio): string {
  const hints: Record<MarkKind, readonly [first: string, second: string]> = {
    lava: ['Click a corner of the lava', 'Click the opposite corner'],
    water: ['Click a corner of the water', 'Click the opposite corner'],
    pad: ['Click where to put the jump pad', ''],
    zipLine: ['Click the start of the zip line', 'Click its end'],
    teleporter: ['Click where to put the teleporter', 'Click its destination'],
    jetpack: ['Click where to put the jetpack', ''],
    anchor: ['Click where to put the anchor', ''],
    spawn: ['Click where play begins', ''],
  }
  return hints[marks.kind.value][marks.begun.value === undefined ? 0 : 1]
}

/** What each tool is for: nothing else gets in its way. Select takes everything. */
export const PICKABLE: Readonly<Record<Tool, ReadonlySet<Hit['kind']> | undefined>> = {
  select: undefined,
  plan: new Set(['ground', 'vertex']),
  forbid: new Set(['edge']),
  add: new Set(['ground']),
  move: new Set(['vertex']),
  remove: new Set(['vertex']),
  force: new Set(['vertex']),
  spawn: new Set(['ground', 'vertex']),
  player: new Set(['ground', 'npc']),
  reach: new Set(['ground', 'vertex']),
  send: new Set(['ground', 'vertex']),
  teleport: new Set(['ground', 'vertex']),
  mark: new Set(['ground']),
  build: new Set(['ground']),
}

export function clicked(studio: Studio, hit: Hit | undefined): void {
  const tool = studio.tool.peek()
  if (EDIT_TOOLS.has(tool) && studio.graphs.id.peek() === undefined) {
    studio.context.toasts.say('There is no graph to edit yet.')
    return
  }
  CLICKS[tool](studio, hit)
}

export function dragged(studio: Studio, vertex: number, to: Place): void {
  const from = studio.graphs.position(vertex)
  if (from !== undefined) void studio.layers.apply(moveVertex(from, to))
}

const CLICKS: Record<Tool, (studio: Studio, hit: Hit | undefined) => void> = {
  select,
  plan: (studio, hit) => {
    if (hit !== undefined) studio.plans.click(hit.at)
  },
  forbid: (studio, hit) => {
    if (hit?.kind === 'edge') forbid(studio, hit.from, hit.to)
  },
  add: (studio, hit) => {
    if (hit?.kind === 'ground') void studio.layers.apply(addVertex(hit.at))
  },
  move: (studio, hit) => {
    if (hit?.kind === 'vertex') studio.graphs.select({ kind: 'vertex', index: hit.index })
  },
  remove: (studio, hit) => {
    if (hit?.kind === 'vertex') remove(studio, hit.index)
  },
  force: (studio, hit) => {
    if (hit?.kind === 'vertex') forceBetween(studio, hit.index)
  },
  spawn: (studio, hit) => {
    const worldId = studio.worlds.chosenId.peek()
    if (hit !== undefined && worldId !== undefined) void studio.npcs.spawn(worldId, hit.at)
  },
  player: (studio, hit) => {
    const worldId = studio.worlds.chosenId.peek()
    if (hit?.kind === 'npc') select(studio, hit)
    else if (hit !== undefined && worldId !== undefined) void studio.player.click(worldId, hit.at)
  },
  reach: (studio, hit) => {
    if (hit !== undefined) studio.reach.setStart(hit.at)
  },
  build: (studio, hit) => {
    const worldId = studio.worlds.chosenId.peek()
    if (hit?.kind === 'ground' && worldId !== undefined) void studio.pieces.click(worldId, hit.at)
  },
  mark: (studio, hit) => {
    if (hit?.kind === 'ground') studio.marks.click(hit.at)
  },
  send: (studio, hit) => withSelected(studio, hit, (id, at) => void studio.npcs.send(id, at)),
  teleport: (studio, hit) =>
    withSelected(studio, hit, (id, at) => {
      const yaw = studio.live.moment.peek().npcs.get(id)?.yaw ?? 0
      void studio.npcs.teleport(id, at, yaw)
    }),
}

function select(studio: Studio, hit: Hit | undefined): void {
  const { graphs, npcs } = studio
  switch (hit?.kind) {
    case 'npc':
      npcs.select(hit.id)
      studio.openTab('npcs')
      return
    case 'vertex':
      graphs.select({ kind: 'vertex', index: hit.index })
      studio.openTab('graph')
      return
    case 'edge':
      graphs.select({ kind: 'edge', from: hit.from, to: hit.to })
      studio.openTab('graph')
      return
    case 'mover':
      drive(studio, hit.index)
      return
    default:
      if (graphs.selection.peek() === undefined) npcs.select(undefined)
      graphs.select(undefined)
  }
}

/** Opens or shuts a door, or sends a lift on. */
function drive({ movers, worlds }: Studio, index: number): void {
  const [mover, worldId] = [movers.list.peek()[index], worlds.chosenId.peek()]
  const order = mover === undefined ? undefined : onClick(mover, movers.states.peek().get(index))
  if (mover !== undefined && order !== undefined && worldId !== undefined) void movers.order(worldId, mover.name, order)
}

export function forbid(studio: Studio, from: number, to: number): void {
  const [start, end] = [studio.graphs.position(from), studio.graphs.position(to)]
  if (start !== undefined && end !== undefined) void studio.layers.apply(forbidEdge(start, end))
}

export function force(studio: Studio, from: number, to: number): void {
  const [start, end] = [studio.graphs.position(from), studio.graphs.position(to)]
  if (start !== undefined && end !== undefined) void studio.layers.apply(forceEdge(start, end))
}

export function remove(studio: Studio, vertex: number): void {
  const at = studio.graphs.position(vertex)
  if (at !== undefined) void studio.layers.apply(removeVertex(at))
}

function forceBetween(studio: Studio, vertex: number): void {
  const from = studio.forceFrom.peek()
  if (from === vertex) return
  studio.forceFrom.value = from === undefined ? vertex : undefined
  if (from !== undefined) force(studio, from, vertex)
}

/** Does something with the selected NPC, and puts the tool down. */
function withSelected(studio: Studio, hit: Hit | undefined, work: (id: bigint, at: Place) => void): void {
  const id = studio.npcs.selectedId.peek()
  if (hit === undefined) return
  if (id !== undefined) work(id, hit.at)
  studio.setTool('select')
}
