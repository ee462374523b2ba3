import { create } from '@bufbuild/protobuf'
import { describe, expect, it } from 'vitest'
import type { Context } from '../../src/data/context'
import { formatOf, Levels, USUAL_OPTIONS } from '../../src/data/world/import'
import { mapName } from '../../src/data/world/worlds'
import { MapKind, MapSpecSchema } from '../../src/gen/surefoot/world/v1/map_pb'
import { MapFormat, UpAxis } from '../../src/gen/surefoot/world/v1/maps_pb'
import { bodyName } from '../../src/ui/map/kinds'

describe('levels of files', () => {
  it.each([
    ['hall.glb', MapFormat.GLTF],
    ['a.b.GLTF', MapFormat.GLTF],
    ['hall.obj', MapFormat.OBJ],
    ['hall.sfmap', MapFormat.SAVED],
    ['hall.fbx', undefined],
    ['hall', undefined],
  ])('%s has the format %s', (name, format) => {
    expect(formatOf(name)).toBe(format)
  })

  it('are sent in parts, in order, and imported as wanted', async () => {
    const parts: [offset: bigint, length: number][] = []
    const requests: object[] = []
    const maps = {
      uploadChunk: ({ offset, data }: { offset: bigint; data: Uint8Array }) => {
        parts.push([offset, data.length])
        return Promise.resolve({})
      },
      importMap: (request: object) => {
        requests.push(request)
        const map = { mapHash: 'abc', name: 'hall.obj', size: { width: 44, height: 22, depth: 24 } }
        const origin = { x: 2, y: 1, z: 22 }
        return Promise.resolve({ map, origin, warnings: ['no ground'], nodes: [] })
      },
    }
    const levels = new Levels({ world: { maps } } as unknown as Context)
    const file = new File([new Uint8Array(600_000)], 'hall.obj')
    const options = { ...USUAL_OPTIONS, scale: 0.01, up: UpAxis.Z }
    await levels.import(file, new File(['{"pads":[]}'], 'hall.surefoot.json'), options)
    expect(parts).toEqual([
      [0n, 524_288],
      [524_288n, 75_712],
    ])
    expect(requests).toMatchObject([
      { name: 'hall.obj', format: MapFormat.OBJ, sidecar: '{"pads":[]}', scale: 0.01, up: 2 },
    ])
    expect(levels.imported.value).toEqual({
      name: 'hall.obj',
      mapHash: 'abc',
      extent: '44 x 24 m, 22 m high',
      warnings: ['no ground'],
      nodes: [],
      geometry: undefined,
      frame: { origin: { x: 2, y: 1, z: 22 }, scale: 0.01, up: UpAxis.Z },
      sidecar: '{"pads":[]}',
    })
    expect(levels.sent.value).toBeUndefined()
    await levels.again(levels.sidecarWith([{ kind: 'pad', at: { x: 12, y: 1, z: 12 } }])!)
    expect(requests[1]).toMatchObject({ name: 'hall.obj', scale: 0.01 })
    const { pads } = JSON.parse((requests[1] as { sidecar: string }).sidecar) as { pads: { at: number[] }[] }
    expect(pads[0]?.at.map(Math.round)).toEqual([1000, 1000, 0])
  })

  it('say what they are called', () => {
    const map = (kind: MapKind) => create(MapSpecSchema, { seed: 7n, kind })
    expect(mapName({ map: map(MapKind.TOWER), mapHash: '' })).toBe('tower, seed 7, 250 x 250 m')
    expect(mapName({ map: map(MapKind.TERRAIN), mapHash: '' })).toBe('seed 7, 250 x 250 m')
    const level = { mapHash: '0123456789abcdef' }
    expect([mapName(level, 'hall.glb'), mapName(level)]).toEqual(['hall.glb', 'imported level 01234567'])
    expect(bodyName({ preset: 'unity', height: 1.8, forwardSpeed: 5.335 })).toBe('Unity')
    expect(bodyName({ preset: '', height: 1.25, forwardSpeed: 4 })).toBe('1.25 m, 4.0 m/s')
  })
})
