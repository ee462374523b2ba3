import { place } from '../../data/format'
import type { Studio } from '../../data/studio'
import type { MarkKind } from '../../data/world/marks'
import { giveFile } from '../capture'
import { Button, Section, SelectField } from '../controls'
import type { BodyName } from './kinds'

const KINDS: readonly { value: MarkKind; name: string }[] = [
  { value: 'lava', name: 'Lava' },
  { value: 'water', name: 'Water' },
  { value: 'pad', name: 'Jump pad' },
  { value: 'zipLine', name: 'Zip line' },
  { value: 'teleporter', name: 'Teleporter' },
  { value: 'jetpack', name: 'Jetpack' },
]

/** Marks features on the level that was imported, and keeps them in its sidecar. */
export function MarksSection({ studio }: { studio: Studio }) {
  const { levels, marks, worlds } = studio
  const imported = levels.imported.value
  const world = worlds.chosen.value
  if (imported?.frame === undefined || world?.mapHash !== imported.mapHash) return null
  const list = marks.list.value
  const body = (world.bodies[0]?.preset || 'surefoot') as BodyName
  const apply = async () => {
    const mapHash = await levels.importWith(marks.list.peek())
    if (mapHash === undefined) return
    marks.clear()
    studio.setTool('select')
    await worlds.create({ mapHash, body: { preset: body } })
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
      {list.length > 0 && (
        <div class="row wrap">
          <Button label="Import with marks" icon="send" tone="main" onClick={() => void apply()} />
          <Button label="Save the sidecar" icon="check" onClick={() => save(studio)} />
        </div>
      )}
      {list.length === 0 && imported.sidecar !== '' && (
        <Button label="Save the sidecar" icon="check" onClick={() => save(studio)} />
      )}
    </Section>
  )
}

/** Gives the browser the file that belongs beside the level's. */
function save({ levels, marks }: Studio): void {
  const sidecar = levels.sidecarWith(marks.list.peek())
  const imported = levels.imported.peek()
  if (sidecar === undefined || imported === undefined) return
  const name = `${imported.name.replace(/\.[^.]*$/, '')}.surefoot.json`
  giveFile(name, new Blob([sidecar], { type: 'application/json' }))
}
