// What the page asks of its 3D view, and what the view tells the page.
//
// Places are in metres, right-handed, y up, as in the contracts. Headings are in radians: 0 faces +z, growing counter-clockwise
// seen from above.

import type { Ability } from '../gen/surefoot/world/v1/map_pb'
import type { Surface } from '../gen/surefoot/world/v1/world_pb'

/** A point, m. */
export interface Place {
  x: number
  y: number
  z: number
}

/** An upright box around something, m. */
export interface Box {
  low: Place
  high: Place
}

/** One tile of a map's triangles, as WorldService.GetMesh sends it. */
export interface MeshTile {
  tileX: number
  tileZ: number
  positions: Float32Array
  indices: Uint32Array
  /** One value of Surface per triangle. */
  surfaces: Uint8Array
}

export interface Features {
  size: { width: number; height: number; depth: number }
  pools: { centre: Place; halfX: number; halfZ: number; round: boolean; depth: number; lava: boolean }[]
  pads: { centre: Place; speed: number }[]
  zipLines: { from: Place; to: Place }[]
  teleporters: { from: Place; to: Place; twoWay: boolean }[]
  jetpacks: Place[]
  /** Places for moves that characters bring along. */
  spots: { tag: string; from: Place; to: Place | undefined; twoWay: boolean }[]
}

export type NpcState = 'idle' | 'seeking' | 'down'

/** An NPC at one moment. */
export interface NpcPose {
  id: bigint
  position: Place
  velocity: Place
  yaw: number
  state: NpcState
  goal?: Place | undefined
}

/** A mover as it was modelled. */
export interface MoverShape {
  /** Corners of its triangles, three numbers each. */
  positions: Float32Array
  pivot: Place
  isDoor: boolean
}

/** Where a mover is, from where it was modelled. */
export interface MoverPose {
  offset: Place
  yaw: number
  isThere: boolean
}

/** A body that the game moves. */
export interface PlayerPose {
  position: Place
  radius: number
  height: number
}

/** What is known of the selected NPC beyond its pose. */
export interface SelectedNpc {
  id: bigint
  /** What is left of its plan: waypoint i is reached by leg i. */
  waypoints: Place[]
  abilities: Ability[]
  /** Index of the waypoint that it heads for. */
  heading: number
  eyes?: Place | undefined
  rays: { end: Place; surface: Surface }[]
}

export interface GraphVertex {
  position: Place
  island: number
  /** NPCs that enter cannot leave. */
  trap: boolean
  /** A designer took it out: it is neither drawn nor picked. */
  removed?: boolean
}

export interface GraphEdge {
  from: number
  to: number
  ability: Ability
  /** 0 to 1. */
  chance: number
  seconds: number
  priceFactor: number
  forced: boolean
  /** No edge leads back, and no other way does either. */
  oneWay: boolean
}

export interface Graph {
  vertices: GraphVertex[]
  edges: GraphEdge[]
}

/** How many NPCs are on each edge, by "from>to"; none on those that are not listed. */
export type Traffic = ReadonlyMap<string, number>

export type EdgeColour = 'chance' | 'seconds' | 'ability' | 'island' | 'traffic'

/** How much of a graph is seen: nothing, thin grey lines, or lines with colours and arrowheads. */
export type GraphPresence = 'off' | 'faint' | 'full'

/** What of a graph is shown. */
export interface GraphFilter {
  presence: GraphPresence
  colour: EdgeColour
  abilities: ReadonlySet<Ability>
  minChance: number
  maxChance: number
  onlyOneWay: boolean
  onlyEdited: boolean
}

/** Where the camera stands: around its target, m and rad. */
export interface CameraPose {
  target: Place
  distance: number
  /** Around the vertical; 0 looks towards -z. */
  azimuth: number
  /** From the vertical; 0 looks straight down. */
  polar: number
}

/** A name on the map. */
export interface Label {
  text: string
  /** What it names, m. */
  at: Place
  /** The NPC that it stays over, `lift` m above its feet, in place of `at`. */
  npc?: { id: bigint; lift: number }
  /** Where there is no room for all, lower ranks are shown. Those of rank 0 are shown behind rock as well. */
  rank: number
  /** Of the dot before the text. */
  colour?: string | undefined
}

/** Labels of one source, which replaces all of them at a time. */
export type LabelGroup = 'places' | 'movers' | 'npc' | 'plan' | 'player' | 'reach'

/** Something that an NPC did, to be shown at any of its moments. */
export interface Replay {
  /** Positions, one per tick (1/60 s), three numbers each. */
  track: Float32Array
  seconds: number
  /** Heading at that moment, rad. */
  yaw: number
  colour: string
}

/** A clip that is being recorded. */
export interface ClipRecording {
  /** Ends it. */
  stop(): Promise<Blob>
}

/** A path to show. */
export interface PathLine {
  start: Place
  waypoints: Place[]
  abilities: Ability[]
  /** The chosen one is drawn bold. */
  chosen: boolean
}

/** A level square of ground that an NPC reaches. */
export interface ReachCell {
  centre: Place
  /** Expected time until the NPC gets there. */
  seconds: number
}

/** What an NPC reaches from a place. */
export interface ReachArea {
  start: Place
  /** Side of the cells, m. */
  side: number
  cells: readonly ReachCell[]
  /** Cells that take longer are not drawn; colours run from 0 to this, s. */
  limit: number
}

/** Changes of the graph that cannot be seen in the graph itself. */
export interface EditMark {
  kind: 'forbidden' | 'removed'
  from: Place
  to?: Place | undefined
}

/** What a click or a hover met, nearest first wins: NPC, vertex, mover, edge, ground. */
export type Hit =
  | { kind: 'npc'; id: bigint; at: Place }
  | { kind: 'vertex'; index: number; at: Place }
  | { kind: 'mover'; index: number; at: Place }
  | { kind: 'edge'; from: number; to: number; at: Place }
  | { kind: 'ground'; at: Place; surface: Surface }

export interface ViewportEvents {
  /** A click without a drag, by mouse, pen or touch; undefined: nothing was hit. */
  click(hit: Hit | undefined, event: PointerEvent): void
  hover(hit: Hit | undefined): void
  /** A vertex was dragged while `setDraggable(true)`: where it was let go on the ground. */
  vertexDragged(index: number, to: Place): void
  /** The camera no longer follows an NPC, since the user moved it or looks at something else. */
  followingEnded(): void
  /** The user turned, moved or zoomed the camera by hand. */
  lookedAround(): void
  /** Detail is wanted around this point: load finer tiles there (sent at most twice a second). */
  detailWanted(around: Place, radius: number): void
}

export interface Theme {
  dark: boolean
}

/** The 3D view. Every setter replaces what was set before; nothing is drawn unless something has changed. */
export interface Viewport {
  /** Forgets the map and all on it. */
  clear(): void
  setFeatures(features: Features): void
  /** Adds a tile, in place of the one of the same place if there is one. `fine`: at full detail. */
  putTile(tile: MeshTile, fine: boolean): void
  /** Takes a tile, "x,z", away. */
  dropTile(key: string): void
  /** Tiles that are shown at full detail, as "x,z". */
  fineTiles(): ReadonlySet<string>
  /** The latest poses with the world's tick (60 a second); the view moves NPCs smoothly from one to the next. */
  setNpcs(tick: bigint, npcs: NpcPose[]): void
  setMovers(movers: MoverShape[]): void
  /** Where movers are, by index. */
  setMoverPoses(poses: ReadonlyMap<number, MoverPose>): void
  setPlayers(players: readonly PlayerPose[]): void
  setTrails(visible: boolean): void
  setSelectedNpc(npc: SelectedNpc | undefined): void
  /** Follows an NPC with the camera, from near by, or stays. */
  follow(id: bigint | undefined): void
  setLabels(group: LabelGroup, labels: readonly Label[]): void
  setLabelsVisible(visible: boolean): void
  /** Shows what an NPC did at one of its moments; the camera follows that while it follows an NPC. */
  setReplay(replay: Replay | undefined): void
  /** Outlines a box, also behind the ground. */
  setOutline(box: Box | undefined): void
  setGraph(graph: Graph | undefined): void
  setGraphFilter(filter: GraphFilter): void
  /** Colours edges by it while they are coloured by traffic. */
  setTraffic(traffic: Traffic): void
  selectVertex(index: number | undefined): void
  selectEdge(edge: { from: number; to: number } | undefined): void
  setDraggable(draggable: boolean): void
  /** What clicks, hovers and drags can meet; undefined: everything. */
  setPickable(kinds: ReadonlySet<Hit['kind']> | undefined): void
  setPaths(paths: PathLine[]): void
  setMarkers(start: Place | undefined, goal: Place | undefined, nearest: Place | undefined): void
  setReachArea(area: ReachArea | undefined): void
  setEditMarks(marks: EditMark[]): void
  /** Places that became unreachable or reachable. */
  setDifference(lost: Place[], gained: Place[]): void
  /** Plays the way of a probe, one position per tick (1/60 s), once, at real speed; then `done` is called. */
  playTrack(track: Float32Array, reached: boolean, done: () => void): void
  /** Hides everything above this height, m; undefined: nothing. */
  setSection(height: number | undefined): void
  /** Looks straight down, or from the side again. */
  setTopView(top: boolean): void
  /** Shows the whole map. */
  frameMap(): void
  /** Looks at a place from the side that the camera is on, and from so near, m. */
  lookAt(place: Place, within?: number): void
  /** Shows a box from near by, from the side that the camera is on. */
  frameBox(box: Box): void
  /** Moves the camera and what it looks at. */
  moveCamera(by: Place): void
  /** Metres from a place to the ground or a wall in a direction of length 1; undefined: there is none. Sections do not count. */
  distanceToGround(origin: Place, direction: Place): number | undefined
  camera(): CameraPose
  /** Goes there at once. */
  setCamera(pose: CameraPose): void
  setTheme(theme: Theme): void
  /** Pixels of the picture as it is now, for tests: draws first. */
  snapshot(): { width: number; height: number; pixels: Uint8Array }
  /** The picture with its labels, as a PNG at full sharpness. */
  picture(): Promise<Blob>
  /** Records the picture with its labels. @throws Error if the browser cannot. */
  record(): ClipRecording
  /** Pictures drawn a second and the page's own milliseconds for each, over the last second. */
  pace(): { framesPerSecond: number; millisecondsPerFrame: number }
  dispose(): void
}
