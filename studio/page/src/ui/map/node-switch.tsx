import { counted } from '../../data/format'
import type { Studio } from '../../data/studio'
import { kindOf, NODE_KINDS, type NodeKind, nameFault, readSidecar, withKind } from '../../data/world/sidecar'
import type { ImportedNode } from '../../gen/surefoot/world/v1/maps_pb'
import { SelectField } from '../controls'

/** Stands for no entry in the sidecar. */
const BY_NAME = { value: '', name: 'As its name says' } as const
/** What nodes are usually switched to. Other kinds are offered where the sidecar has them already. */
const USUAL: ReadonlySet<NodeKind> = new Set(['solid', 'water', 'lava', 'door', 'leave_out'])

interface Props {
  studio: Studio
  node: ImportedNode
  /** Takes the selection back from the keyboard. */
  onLeave: () => void
}

/** Says in the sidecar what the selected node is. */
export function NodeSwitch({ studio: { levels }, node: { name, low }, onLeave }: Props) {
  const imported = levels.imported.value
  if (imported?.frame === undefined) return null
  const fault = nameFault(name)
  const kind = fault === undefined ? kindOf(readSidecar(levels.sidecar.value), name) : undefined
  const kinds = NODE_KINDS.filter(({ value }) => USUAL.has(value) || value === kind)
  const namesakes = imported.nodes.filter((node) => node.name.toLowerCase() === name.toLowerCase()).length
  return (
    <div class="node-switch" onKeyDown={(event) => event.key === 'Escape' && onLeave()}>
      {fault === undefined ? (
        <SelectField<NodeKind | ''>
          label="Import it as"
          value={kind ?? ''}
          options={[BY_NAME, ...kinds]}
          onChange={(value) => levels.edit((sidecar) => withKind(sidecar, name, value === '' ? undefined : value))}
        />
      ) : (
        <p class="note">{fault}</p>
      )}
      {fault === undefined && namesakes > 1 && <p class="note">{counted(namesakes, 'node')} have this name.</p>}
      {low === undefined && <p class="note">It has no triangles of its own to show.</p>}
    </div>
  )
}
