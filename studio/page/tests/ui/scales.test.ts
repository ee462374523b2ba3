import { describe, expect, it } from 'vitest'
import { factorOf, sliderOf } from '../../src/ui/graph/price-scale'
import { layerNameFault } from '../../src/ui/layers/layer-name'
import { sparkPoints } from '../../src/ui/sparkline'

describe('price scale', () => {
  it.each([
    [0.1, -1],
    [1, 0],
    [10, 1],
    [1000, 3],
    [5000, 3],
    [0, -1],
  ])('factor %d lies at %d', (factor, slider) => {
    expect(sliderOf(factor)).toBeCloseTo(slider)
  })

  it.each([
    [-1, 0.1],
    [0, 1],
    [0.4, 2.5],
    [3, 1000],
    [9, 1000],
  ])('%d chooses factor %d', (slider, factor) => {
    expect(factorOf(slider)).toBe(factor)
  })
})

describe('layerNameFault', () => {
  it.each([
    ['night', true],
    [' night ', true],
    ['', false],
    ['   ', false],
    ['a'.repeat(64), true],
    ['a'.repeat(65), false],
    ['ä'.repeat(33), false],
    ['a\tb', false],
  ])('%j is a name: %s', (name, fits) => {
    expect(layerNameFault(name) === undefined).toBe(fits)
  })
})

describe('sparkPoints', () => {
  it('fills the width, and the height with the largest', () => {
    expect(sparkPoints([0, 5, 10], 22, 12)).toBe('1.0,11.0 11.0,6.0 21.0,1.0')
  })

  it('stays within for zeros', () => {
    expect(sparkPoints([0, 0], 22, 12)).toBe('1.0,11.0 21.0,11.0')
  })
})
