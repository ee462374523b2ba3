import { useState } from 'preact/hooks'
import { describe, whereIs } from '../../data/edit/edits'
import { counted } from '../../data/format'
import type { Studio } from '../../data/studio'
import type { Edit, Layer } from '../../gen/surefoot/planner/v1/planner_pb'
import { Button, Empty, Section, SureButton } from '../controls'
import { NoGraph } from '../graph/no-graph'
import { ConflictCard } from './conflict-card'
import { layerNameFault } from './layer-name'

export function LayersPanel({ studio }: { studio: Studio }) {
  const { layers, graphs } = studio
  if (graphs.id.value === undefined) return <NoGraph studio={studio} />
  const list = layers.list.value
  const active = layers.active.value
  const isActiveNew = !list.some(({ name }) => name === active)
  return (
    <>
      {layers.conflict.value !== undefined && <ConflictCard studio={studio} conflict={layers.conflict.value} />}
      <Section title="Layers">
        {layers.failure.value !== '' && <p class="warn">{layers.failure.value}</p>}
        {list.length === 0 && (
          <Empty title="No edits yet">
            <p>Edits are layers on top of the proved graph. NPCs use them from their next plan on.</p>
          </Empty>
        )}
        <NewLayer studio={studio} />
        {isActiveNew && (
          <p class="note">
            Edits go to the new layer <strong>{active}</strong>.
          </p>
        )}
        {list.map((layer) => (
          <LayerCard key={layer.name} studio={studio} layer={layer} />
        ))}
      </Section>
    </>
  )
}

function NewLayer({ studio: { layers } }: { studio: Studio }) {
  const [name, setName] = useState('')
  const fault = layerNameFault(name)
  return (
    <form
      class="row"
      onSubmit={(event) => {
        event.preventDefault()
        if (fault !== undefined) return
        layers.setActive(name.trim())
        setName('')
      }}
    >
      <input
        type="text"
        aria-label="Name of a new layer"
        placeholder="New layer"
        value={name}
        onInput={(event) => setName(event.currentTarget.value)}
      />
      <button type="submit" class="button" disabled={fault !== undefined} title={fault}>
        Add layer
      </button>
    </form>
  )
}

function LayerCard({ studio, layer }: { studio: Studio; layer: Layer }) {
  const { layers } = studio
  const isActive = layer.name === layers.active.value
  return (
    <article class={`layer ${isActive ? 'active' : ''}`} aria-label={`Layer ${layer.name}`}>
      <header>
        <label class="check">
          <input
            type="radio"
            name="active-layer"
            aria-label={`Edit layer ${layer.name}`}
            checked={isActive}
            onChange={() => layers.setActive(layer.name)}
          />
          <strong>{layer.name}</strong>
        </label>
        <span class="note">{counted(layer.edits.length, 'edit')}</span>
        <SureButton
          label={`Delete layer ${layer.name}`}
          question="Delete the layer?"
          icon="trash"
          bare
          onSure={() => void layers.deleteLayer(layer.name)}
        />
      </header>
      <ol class="edits" aria-label={`Edits of ${layer.name}`}>
        {layer.edits.map((edit, index) => (
          <EditRow key={index} studio={studio} layer={layer.name} index={index} edit={edit} />
        ))}
      </ol>
    </article>
  )
}

function EditRow(props: { studio: Studio; layer: string; index: number; edit: Edit }) {
  const { studio, layer, index, edit } = props
  const misfit = studio.layers.unappliedReason(layer, index)
  const at = whereIs(edit)
  return (
    <li class={misfit === undefined ? '' : 'unapplied'}>
      <button type="button" class="item" onClick={() => at !== undefined && studio.viewport.value?.lookAt(at)}>
        {describe(edit)}
        {misfit !== undefined && <span class="warn">Does not fit: {misfit}</span>}
      </button>
      <Button
        label={`Delete edit ${index + 1} of ${layer}`}
        icon="close"
        bare
        onClick={() => void studio.layers.removeEdit(layer, index, edit)}
      />
    </li>
  )
}
