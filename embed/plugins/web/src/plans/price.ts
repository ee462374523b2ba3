// What legs cost: their time and their risks, those of proved edges by their evidence and those of others by the graph's model.
//
// The formulas are those of core/planner/src/evidence.rs and core/planner/src/legs.rs, so that plans in the page are those of the service.

import { distance, scale, subtract, type Vec3, ZERO } from '../vec3.ts'

/** Decisions that a plan may take more to avoid a leg with a chance of 1/e. */
const RISK_DECISIONS = 200
/** Decisions that a careful plan may take more, besides, to avoid a leg that one survives with a chance of 1/e. */
const DEATH_DECISIONS = 1000
/** Lower bound on the chance of an edge. */
const MIN_EDGE_CHANCE = 1e-3
/** Bounds on the chance of an unproved leg. */
const [MIN_LEG_CHANCE, MAX_LEG_CHANCE] = [0.02, 0.99]
/** Upper bound on the distance that a character covers on foot in a decision, m. */
const MAX_METRES_PER_DECISION = 2

/** What is expected of a leg. */
export interface Estimate {
  /** Decisions that it takes if it succeeds. */
  decisions: number
  /** Chance of success, above 0. */
  chance: number
  /** Chance of death, at most 1 - chance. */
  deathChance: number
}

/** What the probes of an edge have shown, as a graph's file has it. */
export interface Evidence {
  tries: number
  successes: number
  deaths: number
  decisionsSum: number
  /** Expected chance of success without any tries; it weighs as much as one. */
  prior: number
  /** Expected share of deaths among failures. */
  deathShare: number
}

/** Coefficients of the graph's model of unproved legs. */
export interface LegModel {
  success: number[]
  decisions: number[]
  /** Length of the longest leg in the fit, m; a longer one counts as several of this length in a row. */
  rangeM: number
  deathShare: number
}

/** The cost of a leg in decisions. Risks count by their logarithms, because chances multiply along a plan. */
export function priceOf({ decisions, chance, deathChance }: Estimate, caution: number): number {
  return decisions / chance - RISK_DECISIONS * Math.log(chance) - caution * DEATH_DECISIONS * Math.log(1 - deathChance)
}

/** What its evidence says of an edge. */
export function estimateOfEdge(evidence: Evidence): Estimate {
  const { tries, successes, deaths, decisionsSum, prior, deathShare } = evidence
  const chance = Math.max((successes + prior) / (tries + 1), MIN_EDGE_CHANCE)
  const deathChance = Math.min((deaths + (1 - prior) * deathShare) / (tries + 1), 1 - chance)
  return { decisions: decisionsSum / Math.max(successes, 1), chance, deathChance }
}

/** What the model says of an unproved leg. */
export function estimateOfLeg(model: LegModel, from: Vec3, to: Vec3): Estimate {
  const metres = distance(from, to)
  const multiple = Math.max(metres / model.rangeM, 1)
  const features = featuresOf(scale(subtract(to, from), 1 / multiple))
  const dot = (weights: number[]) => features.reduce((sum, feature, idx) => sum + feature * weights[idx]!, 0)
  const decisions = Math.max(dot(model.decisions) * multiple, metres / MAX_METRES_PER_DECISION)
  const once = Math.min(Math.max(1 / (1 + Math.exp(-dot(model.success))), MIN_LEG_CHANCE), MAX_LEG_CHANCE)
  const chance = Math.max(once ** multiple, MIN_LEG_CHANCE)
  return { decisions, chance, deathChance: model.deathShare * (1 - chance) }
}

/** Features of a leg: constant, horizontal distance / 20 m and its square, climb / 5 m and its square, drop / 10 m. */
function featuresOf(offset: Vec3): number[] {
  const horizontal = distance({ ...offset, y: 0 }, ZERO) / 20
  const [climb, drop] = [Math.max(offset.y, 0) / 5, Math.max(-offset.y, 0) / 10]
  return [1, horizontal, horizontal * horizontal, climb, climb * climb, drop]
}
