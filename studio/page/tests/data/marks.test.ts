import { describe, expect, it } from 'vitest'
import { featuresWith, Marks, sidecarWith, toLevel, toMap } from '../../src/data/world/marks'
import { UpAxis } from '../../src/gen/surefoot/world/v1/maps_pb'

const at = (x: number, y: number, z: number) => ({ x, y, z })
/** A level in centimetres with z up, whose origin lies at (2, 1, 32) on the map. */
const FRAME = { origin: at(2, 1, 32), scale: 0.01, up: UpAxis.Z }

describe('marks', () => {
  it('of pools and ways take two clicks, others one', () => {
    const marks = new Marks()
    marks.choose('zipLine')
    marks.click(at(1, 0, 1))
    expect([marks.list.value.length, marks.begun.value]).toEqual([0, at(1, 0, 1)])
    marks.click(at(9, 0, 9))
    marks.choose('pad')
    marks.click(at(5, 0, 5))
    expect(marks.list.value).toEqual([
      { kind: 'zipLine', at: at(1, 0, 1), to: at(9, 0, 9) },
      { kind: 'pad', at: at(5, 0, 5) },
    ])
    marks.remove(0)
    expect(marks.list.value.map(({ kind }) => kind)).toEqual(['pad'])
  })

  it('of another kind start over', () => {
    const marks = new Marks()
    marks.click(at(1, 0, 1))
    marks.choose('teleporter')
    expect(marks.begun.value).toBeUndefined()
  })

  it('become places of the level', () => {
    const rounded = (place: readonly number[]) => place.map((value) => Math.round(value))
    expect(rounded(toLevel(at(12, 4, 27), FRAME))).toEqual([1000, 500, 300])
    expect(toMap([1000, 500, 300], FRAME)).toEqual(at(12, 4, 27))
    expect(rounded(toLevel(at(12, 4, 27), { origin: at(2, 1, 2), scale: 1, up: UpAxis.Y }))).toEqual([10, 3, 25])
  })

  it('are listed after what the sidecar had', () => {
    const frame = { origin: at(0, 0, 0), scale: 1, up: UpAxis.Y }
    const text = sidecarWith(
      '{"pads": [{"at": [1, 2, 3], "height": 6}], "jetpacks": []}',
      [
        { kind: 'pad', at: at(4, 5, 6) },
        { kind: 'lava', at: at(9, 1, 2), to: at(3, 1.5, 8) },
        { kind: 'teleporter', at: at(1, 1, 1), to: at(2, 2, 2) },
      ],
      frame,
    )
    expect(JSON.parse(text)).toEqual({
      pads: [
        { at: [1, 2, 3], height: 6 },
        { at: [4, 5, 6], height: 4 },
      ],
      jetpacks: [],
      pools: [{ liquid: 'lava', min: [3, 0, 2], max: [9, 1.8, 8] }],
      teleporters: [{ from: [1, 1, 1], to: [2, 2, 2] }],
    })
  })

  it('are drawn beside the features that are there', () => {
    const none = {
      size: { width: 9, height: 9, depth: 9 },
      pools: [],
      pads: [],
      zipLines: [],
      teleporters: [],
      jetpacks: [],
      spots: [],
    }
    const drawn = featuresWith(none, [
      { kind: 'water', at: at(2, 1, 2), to: at(6, 1, 4) },
      { kind: 'jetpack', at: at(1, 1, 1) },
    ])
    expect(drawn.pools).toMatchObject([{ centre: { x: 4, z: 3 }, halfX: 2, halfZ: 1, lava: false }])
    expect(drawn.jetpacks).toEqual([at(1, 1, 1)])
  })
})
