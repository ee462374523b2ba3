import { type Signal, useSignal } from '@preact/signals'
import { useId, useRef } from 'preact/hooks'
import { count, counted } from '../../data/format'
import type { Studio } from '../../data/studio'
import type { Imported } from '../../data/world/import'
import {
  cut,
  findNodes,
  geometryRows,
  type NodeFilter,
  nodeName,
  roleCounts,
  roleName,
  summaryOf,
} from '../../data/world/report'
import { readSidecar, withNames } from '../../data/world/sidecar'
import { type ImportedNode, NodeRole } from '../../gen/surefoot/world/v1/maps_pb'
import { Button, Check, Empty, Facts, Progress, Section, SelectField } from '../controls'
import { NodeSwitch } from './node-switch'
import { SaveSidecar } from './save-sidecar'

/** Lines that the list has at most: others are found by the filter. */
const MAX_ROWS = 200
/** Characters of a name and of a reason in a line, and in a title. */
const NAME = 60
const REASON = 200
const TITLE = 1000

/** What became of the nodes of the level that was imported, beside its picture. */
export function ReportPanel({ studio }: { studio: Studio }) {
  const imported = studio.levels.imported.value
  if (imported === undefined) return <Empty title="No level was imported" />
  return (
    <>
      <Overview studio={studio} imported={imported} />
      {imported.nodes.length > 0 && <NodeList studio={studio} nodes={imported.nodes} />}
    </>
  )
}

function Overview({ studio, imported }: { studio: Studio; imported: Imported }) {
  const { levels, worlds, showsImported } = studio
  const rows = geometryRows(imported.geometry)
  const world = worlds.list.value.find(({ mapHash }) => mapHash === imported.mapHash)
  const show = () => {
    if (world === undefined) void worlds.create({ mapHash: imported.mapHash })
    else worlds.choose(world.worldId)
  }
  const sent = levels.sent.value
  const summary = imported.nodes.length > 0 ? summaryOf(imported.nodes) : imported.extent
  return (
    <Section title="Report" actions={<SaveSidecar studio={studio} />}>
      <p role="status">{sent === undefined ? `${imported.name}: ${summary}` : 'Importing …'}</p>
      {sent !== undefined && <Progress label="Import" share={sent < 1 ? sent : undefined} />}
      {imported.warnings.length > 0 && (
        <ul class="warnings" aria-label="Warnings">
          {imported.warnings.map((warning, index) => (
            <li key={index} class="warn">
              {warning}
            </li>
          ))}
        </ul>
      )}
      {rows.length > 0 && (
        <details>
          <summary>Geometry</summary>
          <Facts rows={rows} />
        </details>
      )}
      {imported.frame !== undefined && (
        <Check
          label="Names have no meaning"
          checked={readSidecar(levels.sidecar.value).names === false}
          onChange={(checked) => levels.edit((sidecar) => withNames(sidecar, !checked))}
        />
      )}
      {!showsImported.value && (
        <div class="row">
          <Button label="Show the level" icon="play" disabled={worlds.creating.value} onClick={show} />
          <p class="note">Then click a node to see it.</p>
        </div>
      )}
    </Section>
  )
}

function NodeList({ studio, nodes }: { studio: Studio; nodes: readonly ImportedNode[] }) {
  const filter = useSignal<NodeFilter>({ text: '', role: undefined })
  const list = useRef<HTMLUListElement>(null)
  const { selected } = studio.levels
  const found = findNodes(nodes, filter.value, selected.value)
  const leave = () => {
    selected.value = undefined
    list.current?.querySelector<HTMLButtonElement>('.chosen > .item')?.focus()
  }
  return (
    <Section title="Nodes">
      <Filter filter={filter} nodes={nodes} />
      {found.length === 0 && <Empty title="No node matches" />}
      <ul class="list nodes" aria-label="Nodes" ref={list}>
        {found.slice(0, MAX_ROWS).map((node) => (
          <li key={node.index} class={node.index === selected.value ? 'chosen' : ''}>
            <Line studio={studio} node={node} />
            {node.index === selected.value && <NodeSwitch studio={studio} node={node} onLeave={leave} />}
          </li>
        ))}
      </ul>
      {found.length > MAX_ROWS && <p class="note">And {counted(found.length - MAX_ROWS, 'more', 'more')}.</p>}
    </Section>
  )
}

function Filter({ filter, nodes }: { filter: Signal<NodeFilter>; nodes: readonly ImportedNode[] }) {
  const id = useId()
  const { role } = filter.value
  const counts = new Map(roleCounts(nodes))
  // What is chosen stays in the list when its last node is switched.
  if (role !== undefined && !counts.has(role)) counts.set(role, 0)
  const options = [...counts].map(([value, number]) => ({
    value: String(value),
    name: `${roleName(value, number)} (${count(number)})`,
  }))
  return (
    <div class="row">
      <div class="field">
        <label for={id}>Name</label>
        <input
          id={id}
          type="search"
          value={filter.value.text}
          onInput={(event) => (filter.value = { ...filter.peek(), text: event.currentTarget.value })}
        />
      </div>
      <SelectField
        label="Role"
        value={String(role ?? NodeRole.UNSPECIFIED)}
        options={[{ value: String(NodeRole.UNSPECIFIED), name: 'any' }, ...options]}
        onChange={(value) => {
          const chosen = Number(value) as NodeRole
          filter.value = { ...filter.peek(), role: chosen === NodeRole.UNSPECIFIED ? undefined : chosen }
        }}
      />
    </div>
  )
}

function Line({ studio, node }: { studio: Studio; node: ImportedNode }) {
  const { role, reason, triangles } = node
  const name = nodeName(node)
  const about = [reason && cut(reason, REASON), counted(triangles, 'triangle')].filter((part) => part !== '')
  return (
    <button
      type="button"
      class="item"
      aria-pressed={node.index === studio.levels.selected.value}
      onClick={() => studio.selectNode(node.index)}
    >
      <strong title={cut(name, TITLE)}>
        <bdi>{cut(name, NAME)}</bdi>
      </strong>
      <span class="role">{roleName(role)}</span>
      <span class="about">{about.join(' · ')}</span>
    </button>
  )
}
