import { useEffect, useState } from 'preact/hooks'
import { factor as inWords } from '../../data/format'
import { Button, Slider } from '../controls'
import { factorOf, sliderOf } from './price-scale'

/** Chooses a factor from 0.1 to 1000, each step of the slider a share of what it is. */
export function PriceSlider({ factor, onSet }: { factor: number; onSet: (factor: number) => void }) {
  const [at, setAt] = useState(sliderOf(factor))
  useEffect(() => setAt(sliderOf(factor)), [factor])
  const chosen = factorOf(at)
  const isSame = Math.abs(at - sliderOf(factor)) < 0.005
  return (
    <div class="row price">
      <Slider label="Price factor" min={-1} max={3} step={0.01} value={at} shown={inWords(chosen)} onInput={setAt} />
      <Button label="Set price" disabled={isSame} onClick={() => onSet(chosen)} />
    </div>
  )
}
