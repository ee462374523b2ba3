import type { Studio } from '../../data/studio'
import type { PieceKind, Sizes } from '../../data/world/pieces'
import { Button, NumberField, Section, SelectField, SureButton } from '../controls'

const KINDS: readonly { value: PieceKind; name: string }[] = [
  { value: 'block', name: 'Block' },
  { value: 'bridge', name: 'Ramp or bridge' },
  { value: 'lava', name: 'Lava' },
  { value: 'water', name: 'Water' },
]

/** Puts blocks, bridges and pools onto the map of the running world, and takes them away again. */
export function PiecesSection({ studio }: { studio: Studio }) {
  const { pieces } = studio
  const laid = pieces.laid.value
  // A server without support for pieces has no hash of them.
  if (laid === undefined || laid.mapHash === '') return null
  const { worldId } = laid
  const [kind, sizes] = [pieces.kind.value, pieces.sizes.value]
  const isBuilding = studio.tool.value === 'build'
  const size = (label: string, which: keyof Sizes, min: number) => (
    <NumberField
      label={label}
      value={sizes[which]}
      min={min}
      max={100}
      step={0.5}
      onChange={(metres) => (pieces.sizes.value = { ...pieces.sizes.peek(), [which]: metres })}
    />
  )
  return (
    <Section title="Pieces on the map">
      <div class="row">
        <SelectField
          label="Piece"
          value={kind}
          options={KINDS}
          onChange={(kind) => {
            pieces.choose(kind)
            studio.setTool('build')
          }}
        />
        <Button
          label="Add to the map"
          icon="add"
          pressed={isBuilding}
          hint="NPCs and plans use it at once. The level itself does not change."
          onClick={() => studio.setTool(isBuilding ? 'select' : 'build')}
        />
      </div>
      <div class="row">
        {(kind === 'block' || kind === 'bridge') && size('Width, m', 'width', 0.5)}
        {kind === 'block' && size('Height, m', 'height', 0.1)}
      </div>
      <ul class="list pieces" aria-label="Pieces">
        {laid.pieces.map(({ name }) => (
          <li key={name}>
            <span>{name}</span>
            <Button label={`Remove ${name}`} icon="trash" bare onClick={() => void pieces.remove(worldId, name)} />
          </li>
        ))}
      </ul>
      {laid.pieces.length > 1 && (
        <SureButton
          label="Take all away"
          question="Remove all pieces?"
          icon="trash"
          onSure={() => void pieces.clear(worldId)}
        />
      )}
    </Section>
  )
}
