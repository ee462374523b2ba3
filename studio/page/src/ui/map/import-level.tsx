import { useState } from 'preact/hooks'
import { counted } from '../../data/format'
import type { Studio } from '../../data/studio'
import { formatOf, USUAL_OPTIONS } from '../../data/world/import'
import { summaryOf } from '../../data/world/report'
import { UpAxis } from '../../gen/surefoot/world/v1/maps_pb'
import { Button, Check, NumberField, Progress, SelectField } from '../controls'
import { BODIES, type BodyName } from './kinds'
import { SurveyTable } from './survey-table'

const AXES = [
  { value: String(UpAxis.Y), name: 'y' },
  { value: String(UpAxis.Z), name: 'z' },
] as const

/** Takes a level from a file, says what became of it, and makes a world of it. */
export function ImportLevel({ studio }: { studio: Studio }) {
  const { levels, worlds } = studio
  const [files, setFiles] = useState<readonly File[]>([])
  const [options, setOptions] = useState(USUAL_OPTIONS)
  const [body, setBody] = useState<BodyName>('surefoot')
  const [isOver, setIsOver] = useState(false)
  const level = files.find(({ name }) => formatOf(name) !== undefined)
  const sidecar = files.find(({ name }) => name.endsWith('.json'))
  const take = (list: FileList | null | undefined) => {
    setFiles([...(list ?? [])])
    levels.forget()
  }
  const sent = levels.sent.value
  const imported = levels.imported.value
  return (
    <div
      class={`import-level ${isOver ? 'over' : ''}`}
      onDragOver={(event) => {
        event.preventDefault()
        setIsOver(true)
      }}
      onDragLeave={() => setIsOver(false)}
      onDrop={(event) => {
        event.preventDefault()
        setIsOver(false)
        take(event.dataTransfer?.files)
      }}
    >
      <label class="drop">
        <span>Drop a .glb, .gltf, .obj or .sfmap file here, with its .surefoot.json if it has one, or choose them</span>
        <input
          type="file"
          multiple
          accept=".glb,.gltf,.obj,.sfmap,.json"
          onChange={(event) => take(event.currentTarget.files)}
        />
      </label>
      {files.length > 0 && level === undefined && <p class="warn">None of these files is a level.</p>}
      <div class="row">
        <NumberField
          label="Metres per unit"
          min={0.0001}
          max={1000}
          step={0.01}
          value={options.scale}
          onChange={(scale) => setOptions({ ...options, scale })}
        />
        <SelectField
          label="Up"
          value={String(options.up)}
          options={AXES}
          onChange={(up) => setOptions({ ...options, up: Number(up) })}
        />
      </div>
      <Check
        label="Keep all sides as modelled"
        checked={options.keepSides}
        onChange={(keepSides) => setOptions({ ...options, keepSides })}
      />
      <Check
        label="Import all scenes of a glTF"
        checked={options.allScenes}
        onChange={(allScenes) => setOptions({ ...options, allScenes })}
      />
      {sent === undefined ? (
        <button
          type="button"
          class="button"
          disabled={level === undefined}
          onClick={() => level !== undefined && void levels.import(level, sidecar, options)}
        >
          Import
        </button>
      ) : (
        <Progress label="Import" share={sent < 1 ? sent : undefined} />
      )}
      {imported !== undefined && (
        <div class="imported" role="status">
          <p>
            {imported.name}: {imported.extent}
          </p>
          {imported.nodes.length > 0 && <p>{summaryOf(imported.nodes)}</p>}
          <div class="row wrap">
            <Button label="Show the report" icon="look" onClick={() => studio.openTab('report')} />
            {imported.warnings.length > 0 && <span class="warn">{counted(imported.warnings.length, 'warning')}</span>}
          </div>
          <SurveyTable
            studio={studio}
            of={imported.mapHash}
            map={{ mapHash: imported.mapHash }}
            isShown={studio.showsImported.value}
          />
          <SelectField label="Body" value={body} options={BODIES} onChange={setBody} />
          <button
            type="button"
            class="button main"
            disabled={worlds.creating.value}
            onClick={() => void worlds.create({ mapHash: imported.mapHash, body: { preset: body } })}
          >
            {worlds.creating.value ? 'Making it …' : 'Create world'}
          </button>
        </div>
      )}
    </div>
  )
}
