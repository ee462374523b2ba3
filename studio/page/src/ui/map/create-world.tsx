import { useState } from 'preact/hooks'
import type { Studio } from '../../data/studio'
import { Check, NumberField, SelectField, Slider } from '../controls'
import {
  FEATURES,
  type FeatureName,
  MOVERS,
  type MoverName,
  NO_MOVERS,
  randomSeed,
  STANDARD_FEATURES,
} from './features'
import { BODIES, type BodyName, KINDS, type KindValue } from './kinds'

const SIZES = [
  { value: '120', name: '120 m' },
  { value: '250', name: '250 m' },
  { value: '500', name: '500 m' },
  { value: '1000', name: '1 km' },
] as const

type Size = (typeof SIZES)[number]['value']

/** Seed, size, kind, features and movers of a new world, and what its NPCs are like. */
export function CreateWorldForm({ studio: { worlds } }: { studio: Studio }) {
  const [seed, setSeed] = useState(randomSeed)
  const [size, setSize] = useState<Size>('250')
  const [height, setHeight] = useState(80)
  const [kind, setKind] = useState<KindValue>(KINDS[0].value)
  const [body, setBody] = useState<BodyName>('surefoot')
  const [solidNpcs, setSolidNpcs] = useState(true)
  const [features, setFeatures] = useState(STANDARD_FEATURES)
  const [movers, setMovers] = useState(NO_MOVERS)
  const setMover = (name: MoverName, value: number) => setMovers({ ...movers, [name]: value })
  const setFeature = (name: FeatureName, value: number) => setFeatures({ ...features, [name]: value })
  return (
    <form
      class="create-world"
      onSubmit={(event) => {
        event.preventDefault()
        const side = Number(size)
        const map = {
          seed: BigInt(seed),
          size: { width: side, height, depth: side },
          features,
          kind: Number(kind),
          movers,
        }
        void worlds.create({ map, body: { preset: body }, solidNpcs })
        setSeed(randomSeed())
      }}
    >
      <div class="row">
        <NumberField label="Seed" value={seed} min={0} max={Number.MAX_SAFE_INTEGER} onChange={setSeed} />
        <SelectField label="Size" value={size} options={SIZES} onChange={setSize} />
        <NumberField label="Height, m" value={height} min={40} max={200} onChange={setHeight} />
      </div>
      <div class="row">
        <SelectField label="Ground" value={kind} options={KINDS} onChange={setKind} />
        <SelectField label="Body" value={body} options={BODIES} onChange={setBody} />
      </div>
      <Check label="NPCs are solid" checked={solidNpcs} onChange={setSolidNpcs} />
      <details>
        <summary>Features</summary>
        <div class="features">
          {FEATURES.map(({ key, name }) => (
            <Slider
              key={key}
              label={name}
              min={0}
              max={4}
              step={0.25}
              value={features[key]}
              onInput={(value) => setFeature(key, value)}
            />
          ))}
        </div>
      </details>
      <details>
        <summary>Movers</summary>
        <div class="features">
          {MOVERS.map(({ key, name }) => (
            <Slider
              key={key}
              label={name}
              min={0}
              max={4}
              step={0.25}
              value={movers[key]}
              onInput={(value) => setMover(key, value)}
            />
          ))}
        </div>
      </details>
      <button type="submit" class="button main" disabled={worlds.creating.value}>
        {worlds.creating.value ? 'Making it …' : 'Create world'}
      </button>
    </form>
  )
}
