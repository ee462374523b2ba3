import type { JSX } from 'preact'
import { useRef } from 'preact/hooks'
import type { Studio, Tab } from '../data/studio'
import { BuildPanel } from './build/build-panel'
import { GraphPanel } from './graph/graph-panel'
import { LayersPanel } from './layers/layers-panel'
import { MapPanel } from './map/map-panel'
import { ReportPanel } from './map/report-panel'
import { NpcsPanel } from './npcs/npcs-panel'
import { PlanPanel } from './plan/plan-panel'

const TABS: readonly { tab: Tab; name: string; show: (props: { studio: Studio }) => JSX.Element }[] = [
  { tab: 'map', name: 'Map', show: MapPanel },
  { tab: 'report', name: 'Report', show: ReportPanel },
  { tab: 'npcs', name: 'NPCs', show: NpcsPanel },
  { tab: 'graph', name: 'Graph', show: GraphPanel },
  { tab: 'plan', name: 'Plan', show: PlanPanel },
  { tab: 'layers', name: 'Layers', show: LayersPanel },
  { tab: 'build', name: 'Build', show: BuildPanel },
]

export function Panel({ studio }: { studio: Studio }) {
  const list = useRef<HTMLDivElement>(null)
  if (!studio.panelOpen.value) return null
  // There is a report once a level was imported.
  const tabs = TABS.filter(({ tab }) => tab !== 'report' || studio.levels.imported.value !== undefined)
  const current = tabs.find(({ tab }) => tab === studio.tab.value) ?? tabs[0]!
  const step = (event: KeyboardEvent) => {
    const by = { ArrowRight: 1, ArrowLeft: -1 }[event.key]
    if (by === undefined) return
    event.preventDefault()
    const next = tabs[(tabs.indexOf(current) + by + tabs.length) % tabs.length]!
    studio.openTab(next.tab)
    list.current?.querySelector<HTMLButtonElement>(`#tab-${next.tab}`)?.focus()
  }
  const Show = current.show
  return (
    <aside class="panel" aria-label="Side panel">
      <div class="tabs" role="tablist" aria-label="Panels" ref={list} onKeyDown={step}>
        {tabs.map(({ tab, name }) => (
          <button
            key={tab}
            id={`tab-${tab}`}
            type="button"
            role="tab"
            aria-selected={tab === current.tab}
            aria-controls="tab-panel"
            tabIndex={tab === current.tab ? 0 : -1}
            onClick={() => studio.openTab(tab)}
          >
            {name}
            {tab === 'layers' && studio.layers.conflict.value && <i class="badge" role="img" aria-label="conflict" />}
          </button>
        ))}
      </div>
      <div class="tab-panel" id="tab-panel" role="tabpanel" aria-labelledby={`tab-${current.tab}`} tabIndex={0}>
        <Show studio={studio} />
      </div>
    </aside>
  )
}
