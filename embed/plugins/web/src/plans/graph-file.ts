// Reads the JSON that `surefoot graph export --format json` writes. What is wrong with a file is said by the path of the value.

import { checkCount, checkRange, checkVec3, SurefootError } from '../checks.ts'
import { subtract, type Vec3, ZERO } from '../vec3.ts'
import { ABILITIES, type Ability, numberOf } from './plan.ts'
import { type Estimate, estimateOfEdge, type LegModel } from './price.ts'

/** A proved edge. */
export interface Edge {
  from: number
  to: number
  ability: Ability
  estimate: Estimate
  /** Designers' factor on the cost. */
  priceFactor: number
  /** Whether probes have run along it; edges that designers forced have no track. */
  hasTrack: boolean
  /** Whether it is a ride on a mover. */
  isRide: boolean
}

/** A graph as it was read and checked. */
export interface GraphData {
  vertices: Vec3[]
  edges: Edge[]
  legs: LegModel
  /** Names of the body's own moves. */
  moves: string[]
}

const MOST = Number.MAX_VALUE
/** Coefficients of the model of unproved legs. */
const COEFFICIENT_COUNT = 6
const MOST_COUNT = 2 ** 32 - 1

type Json = Record<string, unknown>

/**
 * Reads a graph. Places are less `origin`, where the origin of the page's level lies on the graph's map, m; if it is left out, what the file
 * says of it counts, and nothing if the file does not.
 * @throws SurefootError that says which value of the file is missing or out of range.
 */
export function readGraph(file: unknown, origin?: Vec3): GraphData {
  const root = objectOf('graph file', typeof file === 'string' ? parse(file) : file)
  const shift = origin === undefined ? readOrigin(root.graph as Json | undefined) : checkVec3('origin', origin)
  const vertices = listOf('nodes', root.nodes).map((node, idx) => readVertex(`nodes[${idx}]`, node, idx, shift))
  const links = listOf('edges', root.edges)
  const graph = objectOf('graph', root.graph)
  const moves = readMoves(graph)
  const edges = links.map((link, idx) => readEdge(`edges[${idx}]`, link, vertices.length, moves))
  return { vertices, edges, legs: readLegs(graph), moves }
}

/** The names of the body's own moves. */
function readMoves({ moves }: Json): string[] {
  if (moves === undefined) return []
  return listOf('graph.moves', moves).map((move, idx) => String(objectOf(`graph.moves[${idx}]`, move).id))
}

function parse(text: string): unknown {
  try {
    return JSON.parse(text)
  } catch (error) {
    throw new SurefootError(`the graph file is no JSON (${error}): write it with surefoot graph export --format json`)
  }
}

/** Where the level's origin lies, if the file says it: a list of three numbers. */
function readOrigin(about: Json | undefined): Vec3 {
  if (about?.origin === undefined) return ZERO
  const [x, y, z] = listOf('graph.origin', about.origin)
  return checkVec3('graph.origin', { x, y, z } as Vec3)
}

function readVertex(name: string, value: unknown, idx: number, origin: Vec3): Vec3 {
  const { id, x, y, z } = objectOf(name, value)
  if (id !== idx) throw new SurefootError(`${name}.id is ${String(id)}, but must be ${idx}: ids count from 0 in order`)
  return subtract(checkVec3(name, { x, y, z } as Vec3), origin)
}

function readEdge(name: string, value: unknown, vertexCount: number, moves: string[]): Edge {
  const { source, target, ability, evidence } = objectOf(name, value)
  const from = checkCount(`${name}.source`, source, 0, vertexCount - 1)
  const to = checkCount(`${name}.target`, target, 0, vertexCount - 1)
  if (from === to) throw new SurefootError(`${name} leads from vertex ${from} to itself: remove it`)
  if (numberOf(ability as Ability, moves) === undefined) {
    const names = [...ABILITIES, ...moves].join(', ')
    throw new SurefootError(`${name}.ability is ${String(ability)}, but must be one of ${names}`)
  }
  return {
    from,
    to,
    ability: ability as Ability,
    ...readEvidence(`${name}.evidence`, objectOf(`${name}.evidence`, evidence)),
  }
}

function readEvidence(name: string, json: Json): Omit<Edge, 'from' | 'to' | 'ability'> {
  const count = (field: string) => checkCount(`${name}.${field}`, json[field], 0, MOST_COUNT)
  const share = (field: string) => checkRange(`${name}.${field}`, json[field], 0, 1)
  const evidence = {
    tries: count('tries'),
    successes: count('successes'),
    deaths: count('deaths'),
    decisionsSum: checkRange(`${name}.decisions_sum`, json.decisions_sum, 0, MOST),
    prior: share('prior'),
    deathShare: share('death_share'),
  }
  if (evidence.successes + evidence.deaths > evidence.tries) {
    throw new SurefootError(`${name} has more successes and deaths than tries`)
  }
  if (evidence.decisionsSum === 0 && evidence.successes === 0) {
    throw new SurefootError(`${name} has no successes: such an edge proves nothing, remove it`)
  }
  return {
    estimate: estimateOfEdge(evidence),
    priceFactor: checkRange(`${name}.price_factor`, json.price_factor, Number.MIN_VALUE, MOST),
    hasTrack: hasTrack(json.bounds),
    isRide: ((json.needs ?? {}) as Json).ride != null,
  }
}

/** Without tracks, the lower corner of their bounds is above the upper one. */
function hasTrack(bounds: unknown): boolean {
  const [low, high] = (Array.isArray(bounds) ? bounds : []) as number[][]
  return low !== undefined && high !== undefined && low.every((least, axis) => least <= high[axis]!)
}

function readLegs({ legs }: Json): LegModel {
  const json = objectOf('graph.legs', legs)
  const coefficients = (field: string) => {
    const values = listOf(`graph.legs.${field}`, json[field])
    if (values.length !== COEFFICIENT_COUNT) {
      throw new SurefootError(`graph.legs.${field} has ${values.length} values, but must have ${COEFFICIENT_COUNT}`)
    }
    return values.map((value, idx) => checkRange(`graph.legs.${field}[${idx}]`, value, -MOST, MOST))
  }
  return {
    success: coefficients('success'),
    decisions: coefficients('decisions'),
    rangeM: checkRange('graph.legs.range_m', json.range_m, 1, MOST),
    deathShare: checkRange('graph.legs.death_share', json.death_share, 0, 1),
  }
}

function objectOf(name: string, value: unknown): Json {
  if (typeof value === 'object' && value !== null && !Array.isArray(value)) return value as Json
  throw new SurefootError(`${name} is missing: write the file with surefoot graph export --format json`)
}

function listOf(name: string, value: unknown): unknown[] {
  if (Array.isArray(value)) return value
  throw new SurefootError(`${name} is missing: write the file with surefoot graph export --format json`)
}
