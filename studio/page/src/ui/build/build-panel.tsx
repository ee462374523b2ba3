import { PLACEMENTS } from '../../data/abilities'
import { type BuildState, RANGES, stageName, standardSettings } from '../../data/build/builds'
import { count, duration, percent, timeLeft } from '../../data/format'
import type { Studio } from '../../data/studio'
import { type BuildSettings, BuildStage, Probing } from '../../gen/surefoot/planner/v1/planner_pb'
import { Button, Check, Empty, Facts, NumberField, Progress, Section, SelectField } from '../controls'
import { CompareSection } from './compare-section'

export function BuildPanel({ studio }: { studio: Studio }) {
  const { builds, context } = studio
  const site = studio.site.value
  if (site === undefined) return <Empty title="No world yet" />
  const state = builds.state.value
  const isGone = context.planner.link.state.value === 'lost'
  return (
    <>
      <Section
        title="Build a graph"
        actions={<Button label="Defaults" onClick={() => (builds.settings.value = standardSettings())} />}
      >
        {isGone && (
          <p class="warn">The planner does not answer. Start one with surefoot plan, or everything with surefoot up.</p>
        )}
        <Options studio={studio} />
        <div class="row">
          {state.kind === 'running' ? (
            <Button label="Cancel the build" icon="close" tone="bad" onClick={() => void builds.cancel()} />
          ) : (
            <Button
              label="Start the build"
              icon="play"
              tone="main"
              disabled={isGone}
              onClick={() => void builds.start(site)}
            />
          )}
        </div>
        <Result studio={studio} state={state} />
      </Section>
      <CompareSection studio={studio} />
    </>
  )
}

function Options({ studio: { builds } }: { studio: Studio }) {
  const settings = builds.settings.value
  const number = (label: string, key: keyof typeof RANGES) => {
    const { min, max, step } = RANGES[key]
    const set = (value: number) => builds.set({ [key]: value } satisfies Partial<BuildSettings>)
    return <NumberField label={label} min={min} max={max} step={step} value={round(settings[key])} onChange={set} />
  }
  return (
    <div class="options">
      <SelectField
        label="Placement"
        value={String(settings.placement)}
        options={PLACEMENTS.map(({ value, name }) => ({ value: String(value), name }))}
        onChange={(value) => builds.set({ placement: Number(value) })}
      />
      {number('Vertices', 'vertices')}
      {number('Neighbours', 'neighbours')}
      {number('Most tries', 'repeats')}
      {number('Threshold', 'threshold')}
      <NumberField
        label="Seed"
        min={0}
        max={Number.MAX_SAFE_INTEGER}
        value={Number(settings.seed)}
        onChange={(value) => builds.set({ seed: BigInt(Math.round(value)) })}
      />
      <Check
        label="Run all probes of every candidate"
        checked={settings.probing === Probing.EXHAUSTIVE}
        onChange={(on) => builds.set({ probing: on ? Probing.EXHAUSTIVE : Probing.FRUGAL })}
      />
      <Check
        label="Special moves: devices and ledges"
        checked={!settings.withoutSpecialMoves}
        onChange={(on) => builds.set({ withoutSpecialMoves: !on })}
      />
    </div>
  )
}

/** Shares come back from single precision with a tail of digits. */
function round(value: number): number {
  return Number(value.toFixed(3))
}

function Result({ studio, state }: { studio: Studio; state: BuildState }) {
  switch (state.kind) {
    case 'none':
      return null
    case 'cancelled':
      return (
        <p class="note" role="status">
          Cancelled.
        </p>
      )
    case 'running':
      return <Running state={state} />
    case 'done': {
      const { graphId, mapHash, summary } = state
      const isShown = studio.graphs.id.value === graphId
      const isHere = studio.site.value?.mapHash === mapHash
      return (
        <div class="done">
          <p role="status">{summary.cached ? 'Loaded from the cache.' : `Built in ${duration(summary.buildS)}.`}</p>
          <Facts
            rows={[
              ['Vertices', count(summary.vertices)],
              ['Edges', count(summary.edges)],
              ['Islands', count(summary.islands)],
              ['Pairs connected', percent(summary.connected)],
              ['Probes', count(summary.probes)],
            ]}
          />
          <Button
            label={isShown ? 'It is shown' : 'Show this graph'}
            tone="main"
            disabled={isShown || !isHere}
            onClick={() => studio.graphs.show(mapHash, graphId)}
          />
        </div>
      )
    }
  }
}

function Running({ state: { progress, probingSince } }: { state: Extract<BuildState, { kind: 'running' }> }) {
  const done = Number(progress?.probesDone ?? 0n)
  const total = Number(progress?.probesTotal ?? 0n)
  const left = probingSince === undefined ? undefined : timeLeft(done, total, (performance.now() - probingSince) / 1000)
  return (
    <div class="running" role="status">
      <Progress label="Build" share={total > 0 ? done / total : undefined} />
      <p>
        {stageName(progress?.stage ?? BuildStage.UNSPECIFIED)}
        {total > 0 ? `: ${count(done)} of ${count(total)} probes` : ' …'}
        {left !== undefined && `, ${duration(Math.ceil(left))} left`}
      </p>
    </div>
  )
}
