// A proved graph in the page, and plans on it: the rules of core/planner/src/search.rs, without movers, traffic and tables.

import { distance, lengthOf, subtract, type Vec3 } from '../vec3.ts'
import { type Edge, type GraphData, readGraph } from './graph-file.ts'
import {
  type CheckedQuery,
  checkQuery,
  keyOf,
  type Leg,
  type LegEnds,
  type NoPath,
  type Plan,
  type Planner,
  type Query,
} from './plan.ts'
import { type Estimate, estimateOfLeg, priceOf } from './price.ts'
import { type Attachment, findPath, type Hop, type Path, reachedFrom } from './search.ts'
import { SurefootError } from '../checks.ts'

/** Most vertices that a start or goal is attached to, and most where no path joins the first. */
const [ATTACHMENTS, MORE_ATTACHMENTS] = [6, 48]
/** Distance at which heading straight for the goal is an alternative to the graph, m. */
const DIRECT_M = 20
/** Distance from a vertex within which a place counts as lying at it, m. */
const AT_VERTEX_M = 1
/** Least limit on the climb of the leg to a goal, m: the height of a double jump. */
const LEAST_CLIMB_M = 5
/** Seconds of a decision. */
const DECISION_SECONDS = 1 / 6

export class Graph implements Planner {
  private readonly outgoing: Hop[][]
  private readonly hasIncoming: boolean[]
  /** Places on movers, which unproved legs lead to or from only close by. */
  private readonly berths: Set<number>
  /** Limits of the unproved leg to a goal, m: a goal beyond them stands on ground that no vertex leads to. */
  private readonly reach: { lengthM: number; climbM: number }
  /** The greatest distance that any edge covers for a cost of 1, for plans of any caution, m. */
  private readonly metresPerCost: number

  private constructor(private readonly data: GraphData) {
    const { vertices, edges } = data
    this.outgoing = vertices.map(() => [])
    this.hasIncoming = vertices.map(() => false)
    edges.forEach(({ from, to }, edge) => {
      this.outgoing[from]!.push({ to, edge })
      this.hasIncoming[to] = true
    })
    this.berths = new Set(edges.filter(({ isRide }) => isRide).flatMap(({ from, to }) => [from, to]))
    this.reach = this.reachOnFoot()
    const speeds = edges.map((edge) => lengthOf(this.offsetOf(edge)) / this.costOf(edge, 0))
    this.metresPerCost = speeds.reduce((most, speed) => Math.max(most, speed), Number.MIN_VALUE)
  }

  /**
   * Reads what `surefoot graph export --format json` wrote, as text or parsed. `origin` is where the origin of the page's level lies on
   * the graph's map, m, see `originOf`; absent: where the file says, and nowhere else than the map's own if it does not.
   * @throws SurefootError that says what is wrong with the file.
   */
  static read(file: unknown, origin?: Vec3): Graph {
    return new Graph(readGraph(file, origin))
  }

  /**
   * Loads such a file from an address.
   * @throws SurefootError if there is no such file, or something is wrong with it.
   */
  static async load(address: string | URL, origin?: Vec3): Promise<Graph> {
    const response = await fetch(address)
    if (!response.ok) {
      const message = `there is no graph at ${address} (${response.status} ${response.statusText})`
      throw new SurefootError(`${message}: write one there with surefoot graph export --format json`)
    }
    return Graph.read(await response.text(), origin)
  }

  /** Places where characters can stand, m. */
  get vertices(): readonly Vec3[] {
    return this.data.vertices
  }

  get edges(): readonly Readonly<Edge>[] {
    return this.data.edges
  }

  /** Finds the cheapest plan. If there is no path, the plan says why, and leads to the reachable vertex nearest to the goal. */
  findPath(query: Query): Plan {
    const checked = checkQuery(query, this.data.moves)
    const { start, goal, avoid } = checked
    const isNear = distance(start, goal) <= DIRECT_M && !avoid.has(keyOf({ from: 'start', to: 'goal' }))
    const starts = this.attachStart(checked, ATTACHMENTS, false)
    const path = this.join(starts, this.attachGoal(checked, ATTACHMENTS), checked)
    const directCost = priceOf(estimateOfLeg(this.data.legs, start, goal), checked.caution)
    if (isNear && directCost <= (path?.cost ?? Infinity)) return this.direct(checked)
    return path === undefined ? this.planFromAfar(checked) : this.assemble(checked, path)
  }

  /** Plans where no path joins the cheapest attachments: between more of them, or as near to the goal as paths lead. */
  private planFromAfar(query: CheckedQuery): Plan {
    const starts = this.attachStart(query, MORE_ATTACHMENTS, true)
    const goals = this.attachGoal(query, MORE_ATTACHMENTS)
    const path = this.join(starts, goals, query)
    if (path !== undefined) return this.assemble(query, path)
    const noPath = this.explain(query, starts, goals)
    const nearest = this.nearestReachable(query, starts)
    const detour = nearest === undefined ? undefined : this.join(starts, [{ vertex: nearest, cost: 0 }], query)
    if (nearest === undefined || detour === undefined) return { ...this.direct(query), noPath }
    const { waypoints, legs } = this.assemble(query, detour)
    // The last leg would lead from the vertex to the goal.
    return { waypoints: waypoints.slice(0, -1), legs: legs.slice(0, -1), noPath, nearest: this.data.vertices[nearest]! }
  }

  private join(starts: Attachment[], goals: Attachment[], query: CheckedQuery): Path | undefined {
    const { vertices, edges } = this.data
    const ends = goals.map(({ vertex, cost }) => ({ at: vertices[vertex]!, cost }))
    return findPath({
      outgoing: this.outgoing,
      starts,
      goals,
      costOf: (edge) => (this.isOpen(edge, query) ? this.costOf(edges[edge]!, query.caution) : Infinity),
      bound: (vertex) =>
        ends.reduce(
          (least, { at, cost }) => Math.min(least, distance(vertices[vertex]!, at) / this.metresPerCost + cost),
          Infinity,
        ),
    })
  }

  private isOpen(edge: number, { avoid, without }: CheckedQuery): boolean {
    const { ability, ...ends } = this.data.edges[edge]!
    return !without.has(ability) && (avoid.size === 0 || !avoid.has(keyOf(ends)))
  }

  private costOf({ estimate, priceFactor }: Edge, caution: number): number {
    return priceFactor * priceOf(estimate, caution)
  }

  private attachStart(query: CheckedQuery, most: number, isLimited: boolean): Attachment[] {
    return this.attach(query, most, (vertex) => {
      const leg = { from: 'start', to: vertex, offset: subtract(this.data.vertices[vertex]!, query.start) } as const
      const isOpen = this.outgoing[vertex]!.length > 0 && (!isLimited || this.isInReach(leg.offset))
      return isOpen && this.isBoarded(vertex, query.start) ? leg : undefined
    })
  }

  private attachGoal(query: CheckedQuery, most: number): Attachment[] {
    return this.attach(query, most, (vertex) => {
      const leg = { from: vertex, to: 'goal', offset: subtract(query.goal, this.data.vertices[vertex]!) } as const
      const isOpen = this.hasIncoming[vertex]! && this.isInReach(leg.offset)
      return isOpen && this.isBoarded(vertex, query.goal) ? leg : undefined
    })
  }

  /** The cheapest attachments among the vertices for which there is a leg that the query allows. */
  private attach(
    { avoid, caution }: CheckedQuery,
    most: number,
    legOf: (vertex: number) => (LegEnds & { offset: Vec3 }) | undefined,
  ): Attachment[] {
    const origin = { x: 0, y: 0, z: 0 }
    const attachments: Attachment[] = []
    for (let vertex = 0; vertex < this.data.vertices.length; vertex++) {
      const leg = legOf(vertex)
      if (leg === undefined || avoid.has(keyOf(leg))) continue
      attachments.push({ vertex, cost: priceOf(estimateOfLeg(this.data.legs, origin, leg.offset), caution) })
    }
    return attachments.sort((a, b) => a.cost - b.cost || a.vertex - b.vertex).slice(0, most)
  }

  private isInReach(offset: Vec3): boolean {
    return offset.y <= this.reach.climbM && lengthOf(offset) <= this.reach.lengthM
  }

  private isBoarded(vertex: number, place: Vec3): boolean {
    return !this.berths.has(vertex) || distance(this.data.vertices[vertex]!, place) <= AT_VERTEX_M
  }

  private offsetOf({ from, to }: Edge): Vec3 {
    return subtract(this.data.vertices[to]!, this.data.vertices[from]!)
  }

  /** The longest and the highest edge that was proved on foot; without such edges, the range of the model. */
  private reachOnFoot() {
    const onFoot = this.data.edges.filter(
      ({ ability, hasTrack }) => hasTrack && ['walk', 'jump', 'double_jump'].includes(ability),
    )
    const most = (of: (edge: Edge) => number) =>
      onFoot.length === 0 ? this.data.legs.rangeM : onFoot.reduce((most, edge) => Math.max(most, of(edge)), -Infinity)
    return {
      lengthM: Math.max(
        most((edge) => lengthOf(this.offsetOf(edge))),
        DIRECT_M,
      ),
      climbM: Math.max(
        most((edge) => this.offsetOf(edge).y),
        LEAST_CLIMB_M,
      ),
    }
  }

  private direct({ start, goal }: CheckedQuery): Plan {
    return { waypoints: [goal], legs: [this.unproved({ from: 'start', to: 'goal' }, start, goal)] }
  }

  private assemble({ start, goal }: CheckedQuery, { first, edges }: Path): Plan {
    const { vertices } = this.data
    const passed = edges.map((edge) => this.data.edges[edge]!)
    const last = passed.at(-1)?.to ?? first
    return {
      waypoints: [first, ...passed.map(({ to }) => to)].map((vertex) => vertices[vertex]!).concat(goal),
      legs: [
        this.unproved({ from: 'start', to: first }, start, vertices[first]!),
        ...passed.map(({ from, to, ability, estimate }) => legOf({ from, to }, ability, estimate)),
        this.unproved({ from: last, to: 'goal' }, vertices[last]!, goal),
      ],
    }
  }

  private unproved(ends: LegEnds, from: Vec3, to: Vec3): Leg {
    return legOf(ends, 'walk', estimateOfLeg(this.data.legs, from, to))
  }

  private explain(query: CheckedQuery, starts: Attachment[], goals: Attachment[]): NoPath {
    if (starts.length === 0) return 'start-off-graph'
    if (goals.length === 0) return 'goal-off-graph'
    const reached = this.reached(query, goals)
    return starts.some(({ vertex }) => reached.has(vertex)) ? 'one-way' : 'different-islands'
  }

  /** The vertex nearest to the goal among those that paths lead to; of equally near ones the first. */
  private nearestReachable(query: CheckedQuery, starts: Attachment[]): number | undefined {
    let [best, least]: [number | undefined, number] = [undefined, Infinity]
    for (const vertex of [...this.reached(query, starts)].sort((a, b) => a - b)) {
      const far = distance(this.data.vertices[vertex]!, query.goal)
      if (far < least) [best, least] = [vertex, far]
    }
    return best
  }

  /** What paths lead to if no leg fails: avoided legs are those that failed just now. */
  private reached({ without }: CheckedQuery, from: Attachment[]): Set<number> {
    const vertices = from.map(({ vertex }) => vertex)
    return reachedFrom(this.outgoing, vertices, (edge) => !without.has(this.data.edges[edge]!.ability))
  }
}

function legOf(ends: LegEnds, ability: Leg['ability'], { decisions, chance, deathChance }: Estimate): Leg {
  return { ...ends, ability, seconds: (decisions / chance) * DECISION_SECONDS, chance, deathChance }
}
