// Builds with options, and comparisons of what was built.

import { create } from '@bufbuild/protobuf'
import { signal } from '@preact/signals'
import {
  type Build,
  type BuildSettings,
  BuildSettingsSchema,
  BuildStage,
  type CompareGraphsResponse,
  type GraphSummary,
  Placement,
  Probing,
} from '../../gen/surefoot/planner/v1/planner_pb'
import { type Context, report } from '../context'
import { buildGraph } from '../graph/build-stream'
import { failureOf } from '../net/errors'
import type { Site } from '../world/worlds'

/** Ranges and defaults of settings that are numbers, as the contract gives them. */
export const RANGES = {
  vertices: { min: 2, max: 4096, step: 1, standard: 300 },
  neighbours: { min: 1, max: 64, step: 1, standard: 12 },
  repeats: { min: 1, max: 32, step: 1, standard: 2 },
  threshold: { min: 0.05, max: 1, step: 0.05, standard: 0.2 },
} as const

export function standardSettings(): BuildSettings {
  return create(BuildSettingsSchema, {
    placement: Placement.SPACED,
    vertices: RANGES.vertices.standard,
    neighbours: RANGES.neighbours.standard,
    repeats: RANGES.repeats.standard,
    threshold: RANGES.threshold.standard,
    probing: Probing.FRUGAL,
  })
}

const STAGES: Record<BuildStage, string> = {
  [BuildStage.UNSPECIFIED]: 'Starting',
  [BuildStage.QUEUED]: 'Waiting for another build',
  [BuildStage.MAP]: 'Making the map',
  [BuildStage.VERTICES]: 'Placing vertices',
  [BuildStage.PROBES]: 'Probing edges',
  [BuildStage.INDEX]: 'Preparing the search',
  [BuildStage.DONE]: 'Done',
  [BuildStage.FAILED]: 'Failed',
  [BuildStage.CANCELLED]: 'Cancelled',
}

export function stageName(stage: BuildStage): string {
  return STAGES[stage]
}

export type BuildState =
  | { kind: 'none' }
  | { kind: 'running'; progress: Build | undefined; probingSince: number | undefined }
  | { kind: 'done'; graphId: string; mapHash: string; summary: GraphSummary }
  | { kind: 'cancelled' }

export interface Comparison {
  before: string
  after: string
  result: CompareGraphsResponse
}

export class Builds {
  readonly settings = signal<BuildSettings>(standardSettings())
  readonly state = signal<BuildState>({ kind: 'none' })
  readonly comparison = signal<Comparison | undefined>(undefined)
  readonly comparing = signal(false)
  private running: AbortController | undefined

  constructor(
    private readonly context: Context,
    /** Called when a build is done. */
    private readonly onDone: () => void,
  ) {}

  set(change: Partial<BuildSettings>): void {
    this.settings.value = { ...this.settings.value, ...change }
  }

  async start(site: Site): Promise<void> {
    this.running?.abort()
    const running = new AbortController()
    this.running = running
    let probingSince: number | undefined
    this.state.value = { kind: 'running', progress: undefined, probingSince }
    try {
      for await (const progress of buildGraph(this.context, site, this.settings.value, running.signal)) {
        if (progress.stage === BuildStage.PROBES) probingSince ??= performance.now()
        this.state.value = { kind: 'running', progress, probingSince }
        if (progress.summary === undefined) continue
        const { graphId, summary } = progress
        this.state.value = { kind: 'done', graphId, mapHash: site.mapHash, summary }
        this.onDone()
      }
    } catch (error) {
      const isCancelled = running.signal.aborted || failureOf(error) === 'cancelled'
      this.state.value = isCancelled ? { kind: 'cancelled' } : { kind: 'none' }
      if (!isCancelled) report(this.context, 'The build failed', error)
    }
  }

  /** Cancels the build on the planner, for everybody who waits for it. */
  async cancel(): Promise<void> {
    const state = this.state.peek()
    this.running?.abort()
    this.state.value = { kind: 'cancelled' }
    if (state.kind !== 'running' || state.progress === undefined) return
    try {
      await this.context.planner.calls.cancelBuild({ buildId: state.progress.buildId })
    } catch (error) {
      report(this.context, 'The build was not cancelled', error)
    }
  }

  async compare(before: string, after: string): Promise<void> {
    this.comparing.value = true
    try {
      const result = await this.context.planner.calls.compareGraphs({ before, after })
      this.comparison.value = { before, after, result }
    } catch (error) {
      report(this.context, 'The graphs were not compared', error)
    } finally {
      this.comparing.value = false
    }
  }

  clearComparison(): void {
    this.comparison.value = undefined
  }
}
