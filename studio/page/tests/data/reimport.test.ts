import { Code, ConnectError, createClient, createRouterTransport } from '@connectrpc/connect'
import { describe, expect, it } from 'vitest'
import type { Context } from '../../src/data/context'
import { Link } from '../../src/data/net/link'
import { Session } from '../../src/data/net/session'
import { importAgain } from '../../src/data/reimport'
import { Studio } from '../../src/data/studio'
import { Toasts } from '../../src/data/toasts'
import { USUAL_OPTIONS } from '../../src/data/world/import'
import { withKind } from '../../src/data/world/sidecar'
import { MapService, NodeRole } from '../../src/gen/surefoot/world/v1/maps_pb'
import { WorldService } from '../../src/gen/surefoot/world/v1/world_pb'

/** A studio on a server whose maps are called by their sidecars, and on which what is left out moves the origin. */
async function studioWithLevel() {
  const dropped: bigint[] = []
  const imports: string[] = []
  let worlds = 0n
  const transport = createRouterTransport(({ service }) => {
    service(MapService, {
      uploadChunk: () => ({}),
      importMap: ({ sidecar, name }) => {
        imports.push(sidecar)
        if (sidecar.includes('door')) throw new ConnectError('Sky is no door', Code.InvalidArgument)
        const isOut = sidecar.includes('leave_out')
        const nodes = [{ index: 0, name: 'Sky', role: isOut ? NodeRole.LEFT_OUT : NodeRole.SOLID }]
        const origin = { x: isOut ? 2 : 50, y: 1, z: 2 }
        return { map: { mapHash: `hash ${sidecar}`, name }, origin, nodes }
      },
      listMaps: () => ({ maps: imports.map((sidecar) => ({ mapHash: `hash ${sidecar}`, name: 'hall.glb' })) }),
    })
    service(WorldService, {
      createWorld: ({ mapHash, body, solidNpcs }) => {
        worlds += 1n
        return { world: { worldId: worlds, mapHash, bodies: body ? [body] : [], solidNpcs: solidNpcs ?? true } }
      },
      dropWorld: ({ worldId }) => {
        dropped.push(worldId)
        return {}
      },
    })
  })
  const toasts = new Toasts()
  const side = { link: new Link(), session: new Session('http://localhost', undefined), address: '', isForeign: false }
  const world = {
    ...side,
    maps: createClient(MapService, transport),
    calls: createClient(WorldService, transport),
  }
  const { signal } = new AbortController()
  const studio = new Studio({ world, planner: world, toasts, store: undefined, signal } as unknown as Context)
  await studio.levels.import(new File(['x'], 'hall.glb'), undefined, USUAL_OPTIONS)
  await studio.worlds.create({ mapHash: 'hash ', body: { preset: 'unity' } })
  const leaveSkyOut = () => studio.levels.edit((sidecar) => withKind(sidecar, 'Sky', 'leave_out'))
  return { studio, imports, dropped, toasts, leaveSkyOut }
}

describe('a level whose sidecar has changed', () => {
  it('is shown in place of the one before, with marks where they were on the level', async () => {
    const { studio, imports, dropped, leaveSkyOut } = await studioWithLevel()
    const { levels, marks, worlds } = studio
    marks.list.value = [{ kind: 'pad', at: { x: 60, y: 1, z: 5 } }]
    leaveSkyOut()
    expect(levels.unsent.value).toBe(levels.sidecar.value)
    expect(await importAgain(studio, levels.sidecar.value)).toBe(true)
    expect(levels.unsent.value).toBeUndefined()
    expect(JSON.parse(imports[1]!)).toEqual({ nodes: { Sky: 'leave_out' } })
    expect(levels.imported.value?.nodes.map(({ role }) => role)).toEqual([NodeRole.LEFT_OUT])
    expect(studio.showsImported.value).toBe(true)
    expect(worlds.chosen.value?.bodies[0]?.preset).toBe('unity')
    expect(dropped).toEqual([1n])
    expect(marks.list.value).toEqual([{ kind: 'pad', at: { x: 12, y: 1, z: 5 } }])
  })

  it('goes on from what it was where the change is refused', async () => {
    const { studio, toasts } = await studioWithLevel()
    const { levels, worlds } = studio
    levels.edit((sidecar) => withKind(sidecar, 'Sky', 'door'))
    expect(await importAgain(studio, levels.sidecar.value)).toBe(false)
    expect(levels.sidecar.value).toBe('')
    expect(levels.unsent.value).toBeUndefined()
    expect(worlds.chosen.value?.worldId).toBe(1n)
    expect(toasts.shown.value.map(({ text }) => text)).toEqual([
      'The level was not imported with this change: Sky is no door.',
    ])
  })

  it('lists the marks once they are imported', async () => {
    const { studio, imports } = await studioWithLevel()
    const { levels, marks } = studio
    marks.list.value = [{ kind: 'jetpack', at: { x: 60, y: 1, z: 5 } }]
    await importAgain(studio, levels.sidecarWith(marks.list.value)!, true)
    expect(JSON.parse(imports[1]!)).toEqual({ jetpacks: [{ at: [10, 0, 3] }] })
    expect([marks.list.value, levels.sidecar.value]).toEqual([[], imports[1]])
  })

  it('leaves other worlds alone', async () => {
    const { studio, dropped, leaveSkyOut } = await studioWithLevel()
    const { levels, worlds } = studio
    await worlds.create({ mapHash: 'of another level' })
    leaveSkyOut()
    expect(await importAgain(studio, levels.sidecar.value)).toBe(true)
    expect([worlds.chosen.value?.mapHash, dropped]).toEqual(['of another level', []])
  })

  it('is called by its name', async () => {
    const { studio } = await studioWithLevel()
    const { worlds } = studio
    await expect.poll(() => worlds.nameOf(worlds.chosen.value!)).toBe('hall.glb')
  })
})
