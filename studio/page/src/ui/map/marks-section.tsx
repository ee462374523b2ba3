import { place } from '../../data/format'
import { importAgain } from '../../data/reimport'
import type { Studio } from '../../data/studio'
import type { MarkKind } from '../../data/world/marks'
import { Button, Section, SelectField } from '../controls'
import { SaveSidecar } from './save-sidecar'

const KINDS: readonly { value: MarkKind; name: string }[] = [
  { value: 'lava', name: 'Lava' },
  { value: 'water', name: 'Water' },
  { value: 'pad', name: 'Jump pad' },
  { value: 'zipLine', name: 'Zip line' },
  { value: 'teleporter', name: 'Teleporter' },
  { value: 'jetpack', name: 'Jetpack' },
  { value: 'anchor', name: 'Anchor' },
  { value: 'spawn', name: 'Spawn point' },
]

/** Marks features on the level that was imported, and keeps them in its sidecar. */
export function MarksSection({ studio }: { studio: Studio }) {
  const { levels, marks, showsImported } = studio
  if (levels.imported.value?.frame === undefined || !showsImported.value) return null
  const list = marks.list.value
  const apply = async () => {
    const sidecar = levels.sidecarWith(marks.list.peek())
    if (sidecar !== undefined && (await importAgain(studio, sidecar, true))) studio.setTool('select')
  }
  return (
    <Section title="Mark features">
      <div class="row">
        <SelectField
          label="Feature"
          value={marks.kind.value}
          options={KINDS}
          onChange={(kind) => {
            marks.choose(kind)
            studio.setTool('mark')
          }}
        />
        <Button
          label="Mark on the map"
          icon="add"
          pressed={studio.tool.value === 'mark'}
          onClick={() => studio.setTool(studio.tool.value === 'mark' ? 'select' : 'mark')}
        />
      </div>
      <ul class="list marks" aria-label="Marks">
        {list.map((mark, index) => (
          <li key={index}>
            <span>
              {KINDS.find(({ value }) => value === mark.kind)?.name} at {place(mark.at)}
              {mark.to === undefined ? '' : ` to ${place(mark.to)}`}
            </span>
            <Button label="Remove this mark" icon="trash" bare onClick={() => marks.remove(index)} />
          </li>
        ))}
      </ul>
      <div class="row wrap">
        {list.length > 0 && (
          <Button
            label="Import with marks"
            icon="send"
            tone="main"
            disabled={levels.isBusy.value}
            onClick={() => void apply()}
          />
        )}
        <SaveSidecar studio={studio} />
      </div>
    </Section>
  )
}
