import { create } from '@bufbuild/protobuf'
import { Code, ConnectError, createClient, createRouterTransport } from '@connectrpc/connect'
import { beforeEach, describe, expect, it, vi } from 'vitest'
import type { Context } from '../../src/data/context'
import { addVertex, describe as inWords, forbidEdge, removeVertex } from '../../src/data/edit/edits'
import { Layers, withLayer } from '../../src/data/edit/layers'
import { Link } from '../../src/data/net/link'
import { Session } from '../../src/data/net/session'
import { Toasts } from '../../src/data/toasts'
import { type Edit, type Layer, LayerSchema, PlannerService } from '../../src/gen/surefoot/planner/v1/planner_pb'
import { MapService } from '../../src/gen/surefoot/world/v1/maps_pb'
import { WorldService } from '../../src/gen/surefoot/world/v1/world_pb'

/** A planner that keeps layers as the real one does. */
class Planner {
  layers: Layer[] = []
  revision = 1n
  /** What it says about the first edit of the layer `misfits`. */
  readonly reason = 'no vertex stands there'
  /** Refuses the next change with this. */
  fault: ConnectError | undefined
  /** Refuses to tell its layers with this. */
  deaf: ConnectError | undefined
  /** Takes the next change, but its answer is lost. */
  isMute = false

  change(name: string, ifRevision: bigint, edits: (before: Edit[]) => Edit[]) {
    const { fault } = this
    this.fault = undefined
    if (fault !== undefined) throw fault
    if (ifRevision !== 0n && ifRevision !== this.revision) throw new ConnectError('other revision', Code.Aborted)
    const before = this.layers.find((layer) => layer.name === name)?.edits ?? []
    this.layers = withLayer(this.layers, name, edits(before))
    this.revision += 1n
    if (this.isMute) {
      this.isMute = false
      throw new ConnectError('Failed to fetch', Code.Unknown)
    }
    const isUnapplied = this.layers.some((layer) => layer.name === 'misfits')
    return {
      revision: this.revision,
      unapplied: isUnapplied ? [{ layer: 'misfits', index: 0, reason: this.reason }] : [],
    }
  }

  /** What another designer does. */
  elsewhere(name: string, ...edits: Edit[]): void {
    this.change(name, 0n, (before) => [...before, ...edits])
  }

  readonly transport = createRouterTransport(({ service }) => {
    service(PlannerService, {
      getLayers: () => {
        if (this.deaf !== undefined) throw this.deaf
        return { layers: this.layers, revision: this.revision, unapplied: [] }
      },
      appendEdits: ({ layer, edits, ifRevision }) => this.change(layer, ifRevision, (before) => [...before, ...edits]),
      undoEdits: ({ layer, count, ifRevision }) => this.change(layer, ifRevision, (before) => before.slice(0, -count)),
      putLayer: ({ layer, ifRevision }) => this.change(layer?.name ?? '', ifRevision, () => layer?.edits ?? []),
    })
  })
}

function contextFor({ transport }: Planner): Context {
  const session = new Session('http://127.0.0.1:7601', undefined)
  const side = { address: '', isForeign: false, session, link: new Link(), maps: createClient(MapService, transport) }
  return {
    world: { ...side, calls: createClient(WorldService, transport) },
    planner: { ...side, calls: createClient(PlannerService, transport) },
    toasts: new Toasts(),
    store: undefined,
    signal: new AbortController().signal,
  }
}

const at = (x: number) => ({ x, y: 0, z: 0 })
const [one, two, three] = [forbidEdge(at(1), at(2)), addVertex(at(3)), removeVertex(at(4))]

let planner: Planner
let context: Context
let layers: Layers
let changes: number

const said = () => context.toasts.shown.value.map(({ text }) => text)
const kept = () => planner.layers.map((layer) => [layer.name, layer.edits.map(inWords)])
const known = () => layers.list.value.map((layer) => [layer.name, layer.edits.map(inWords)])

/** Lets everything that was begun come to its end. */
const settle = () => layers.redo()

beforeEach(async () => {
  planner = new Planner()
  context = contextFor(planner)
  changes = 0
  layers = new Layers(context, () => (changes += 1))
  layers.setActive('mine')
  layers.sync({ id: 'graph', mapHash: 'map', revision: planner.revision })
  await settle()
})

describe('edits', () => {
  it('go to the active layer, and are known without asking again', async () => {
    await layers.apply(one)
    layers.setActive('other')
    await layers.apply(two)
    expect(kept()).toEqual([
      ['mine', [inWords(one)]],
      ['other', [inWords(two)]],
    ])
    expect(known()).toEqual(kept())
    expect(changes).toBe(2)
  })

  it('are sent one after the other', async () => {
    await Promise.all([layers.apply(one), layers.apply(two), layers.apply(three)])
    expect(kept()).toEqual([['mine', [one, two, three].map(inWords)]])
    expect(layers.conflict.value).toBeUndefined()
  })

  it('that find nothing to change say so at once', async () => {
    layers.setActive('misfits')
    await layers.apply(one)
    expect(said()).toEqual([`The edit is kept, but changes nothing: ${planner.reason}.`])
  })

  it('that are wrong are not held', async () => {
    planner.fault = new ConnectError('factor is 0', Code.InvalidArgument)
    await layers.apply(one)
    expect(layers.conflict.value).toBeUndefined()
    expect(said()[0]).toContain('Factor is 0.')
  })

  it.each([
    ['the planner is gone', new ConnectError('Failed to fetch', Code.Unknown)],
    ['the role is too low', new ConnectError('', Code.PermissionDenied)],
    ['the graph is not loaded', new ConnectError('no such graph', Code.NotFound)],
    ['a token is missing', new ConnectError('', Code.Unauthenticated)],
  ])('are held when %s, and can be applied again', async (_, fault) => {
    planner.fault = fault
    await layers.apply(one)
    expect(layers.conflict.value?.held.flatMap(({ edits }) => edits)).toEqual([one])
    await layers.applyOnTop()
    expect(layers.conflict.value).toBeUndefined()
    expect(kept()).toEqual([['mine', [inWords(one)]]])
  })

  it('that belong together are sent, undone and done again as one', async () => {
    await layers.apply(three)
    await layers.apply(one, two)
    expect(kept()).toEqual([['mine', [three, one, two].map(inWords)]])
    await layers.undo()
    expect(kept()).toEqual([['mine', [inWords(three)]]])
    expect(known()).toEqual(kept())
    await layers.redo()
    expect(kept()).toEqual([['mine', [three, one, two].map(inWords)]])
  })

  it('whose answer was lost are not applied twice', async () => {
    await layers.apply(one)
    planner.isMute = true
    await layers.apply(one)
    await layers.apply(two)
    await layers.applyOnTop()
    expect(kept()).toEqual([['mine', [one, one, two].map(inWords)]])
    expect(layers.conflict.value).toBeUndefined()
    await layers.undo()
    await layers.undo()
    expect(kept()).toEqual([['mine', [inWords(one)]]])
  })

  it('whose answer was lost are found although another user has made changes', async () => {
    planner.isMute = true
    await layers.apply(one)
    planner.elsewhere('mine', two)
    await layers.applyOnTop()
    expect(kept()).toEqual([['mine', [one, two].map(inWords)]])
  })

  it('stay held while it cannot be known whether they were taken', async () => {
    planner.isMute = true
    await layers.apply(one)
    planner.deaf = new ConnectError('Failed to fetch', Code.Unknown)
    await layers.applyOnTop()
    expect(layers.conflict.value?.held.flatMap(({ edits }) => edits)).toEqual([one])
    expect(kept()).toEqual([['mine', [inWords(one)]]])
  })

  it("ask for a designer's token when the role is too low", async () => {
    planner.fault = new ConnectError('', Code.PermissionDenied)
    await layers.apply(one)
    expect(context.planner.session.wanted.value).toContain("designer's token")
  })
})

describe('a conflict', () => {
  beforeEach(async () => {
    planner.elsewhere('theirs', two)
    await layers.apply(one)
  })

  it('holds the edit and shows what the other one did', () => {
    const conflict = layers.conflict.value
    expect(conflict?.held).toEqual([{ layer: 'mine', edits: [one] }])
    expect(conflict?.changes).toMatchObject([{ layer: 'theirs', kind: 'new', added: [two] }])
    expect(kept()).toEqual([['theirs', [inWords(two)]]])
    expect(known()).toEqual(kept())
  })

  it('holds what comes after it as well', async () => {
    await layers.apply(three)
    expect(layers.conflict.value?.held.flatMap(({ edits }) => edits)).toEqual([one, three])
    await layers.applyOnTop()
    expect(kept()).toEqual([
      ['mine', [inWords(one), inWords(three)]],
      ['theirs', [inWords(two)]],
    ])
  })

  it('may come again, without losing anything', async () => {
    await layers.apply(three)
    planner.elsewhere('theirs', one)
    await layers.applyOnTop()
    expect(layers.conflict.value?.held.flatMap(({ edits }) => edits)).toEqual([one, three])
    await layers.applyOnTop()
    expect(layers.conflict.value).toBeUndefined()
    expect(kept()[0]).toEqual(['mine', [inWords(one), inWords(three)]])
  })

  it.each([
    ['gone', new ConnectError('Failed to fetch', Code.Unknown)],
    ['without the graph', new ConnectError('no such graph', Code.NotFound)],
    ['broken', new ConnectError('', Code.Internal)],
  ])('holds everything while the planner is %s', async (_, deaf) => {
    await layers.apply(three)
    planner.elsewhere('theirs', one)
    planner.deaf = deaf
    await layers.applyOnTop()
    expect(layers.conflict.value?.held.flatMap(({ edits }) => edits)).toEqual([one, three])
    planner.deaf = undefined
    await layers.applyOnTop()
    await layers.applyOnTop()
    expect(layers.conflict.value).toBeUndefined()
    expect(kept()[0]).toEqual(['mine', [inWords(one), inWords(three)]])
  })

  it('is there at once, before the layers were read', async () => {
    layers.discardConflict()
    planner.elsewhere('theirs', three)
    planner.deaf = new ConnectError('Failed to fetch', Code.Unknown)
    await layers.apply(one)
    expect(layers.conflict.value?.held).toMatchObject([{ layer: 'mine', edits: [one] }])
    expect(layers.failure.value).not.toBe('')
  })

  it('can be discarded', async () => {
    layers.discardConflict()
    await layers.apply(three)
    expect(kept()[0]).toEqual(['mine', [inWords(three)]])
  })
})

describe('undo and redo', () => {
  it('go through layers in the order of the edits', async () => {
    await layers.apply(one)
    layers.setActive('other')
    await layers.apply(two)
    await layers.undo()
    expect(kept()).toEqual([['mine', [inWords(one)]]])
    await layers.undo()
    expect(kept()).toEqual([])
    await layers.redo()
    await layers.redo()
    expect(known()).toEqual([
      ['mine', [inWords(one)]],
      ['other', [inWords(two)]],
    ])
    expect(layers.canRedo.value).toBe(false)
  })

  it("never take another designer's edit back", async () => {
    await layers.apply(one)
    planner.elsewhere('mine', two)
    await layers.undo()
    expect(kept()).toEqual([['mine', [inWords(one), inWords(two)]]])
    expect(said().at(-1)).toContain('not yours any more')
  })

  it('go on after a change in another layer', async () => {
    await layers.apply(one)
    planner.elsewhere('theirs', two)
    await layers.undo()
    expect(kept()).toEqual([['theirs', [inWords(two)]]])
    expect(known()).toEqual(kept())
  })

  it('bring back a deleted edit and a deleted layer', async () => {
    await layers.apply(one)
    await layers.apply(two)
    await layers.removeEdit('mine', 0, one)
    expect(kept()).toEqual([['mine', [inWords(two)]]])
    await layers.deleteLayer('mine')
    expect(kept()).toEqual([])
    await layers.undo()
    await layers.undo()
    expect(kept()).toEqual([['mine', [inWords(one), inWords(two)]]])
  })
})

describe('what happens elsewhere', () => {
  it('is adopted and reported', async () => {
    planner.elsewhere('night', one, two)
    layers.sync({ id: 'graph', mapHash: 'map', revision: planner.revision })
    await settle()
    expect(known()).toEqual(kept())
    expect(said()).toEqual(['Layer night was made elsewhere: +2 edits'])
  })

  it('is not said of what this page did', async () => {
    await layers.apply(one)
    layers.sync({ id: 'graph', mapHash: 'map', revision: planner.revision })
    await settle()
    expect(said()).toEqual([])
  })

  it('is not said of another graph', async () => {
    planner.elsewhere('night', one)
    layers.sync({ id: 'other graph', mapHash: 'map', revision: planner.revision })
    await settle()
    expect(said()).toEqual([])
    expect(known()).toEqual(kept())
  })
})

describe('leaving a world', () => {
  const comeBack = async (mapHash: string) => {
    layers.forget()
    layers.sync({ id: 'graph', mapHash, revision: planner.revision })
    await settle()
  }

  it('keeps what was done and held, if the same map comes again', async () => {
    await layers.apply(one)
    planner.fault = new ConnectError('Failed to fetch', Code.Unknown)
    await layers.apply(two)
    await comeBack('map')
    expect(layers.conflict.value?.held).toHaveLength(1)
    await layers.undo()
    expect(kept()).toEqual([])
  })

  it('puts it aside for another map', async () => {
    await layers.apply(one)
    planner.fault = new ConnectError('Failed to fetch', Code.Unknown)
    await layers.apply(two)
    await comeBack('other map')
    expect(layers.canUndo.value).toBe(false)
    expect(layers.conflict.value).toBeUndefined()
    expect(known()).toEqual(kept())
    await comeBack('map')
    expect(layers.canUndo.value).toBe(true)
    expect(layers.conflict.value?.held).toHaveLength(1)
  })

  it('remembers a few maps only', async () => {
    await layers.apply(one)
    for (let other = 0; other < 9; other += 1) await comeBack(`map ${other}`)
    await comeBack('map')
    expect(layers.canUndo.value).toBe(false)
  })

  it('says that nothing can be changed, and forgets nothing', async () => {
    await layers.apply(one)
    layers.forget()
    await layers.undo()
    expect(said()).toEqual(['Not undone: The graph and its layers are not loaded yet.'])
    expect(layers.canUndo.value).toBe(true)
    await layers.apply(two)
    expect(layers.conflict.value).toMatchObject({ why: 'The graph and its layers are not loaded yet.' })
  })
})

describe('layers that cannot be read', () => {
  const another = async () => {
    planner.deaf = new ConnectError('Failed to fetch', Code.Unknown)
    layers.sync({ id: 'other graph', mapHash: 'map', revision: planner.revision })
    await settle()
  }

  it('are read again by and by', async () => {
    planner.elsewhere('night', one)
    await another()
    expect(layers.failure.value).not.toBe('')
    planner.deaf = undefined
    await vi.waitFor(() => expect(layers.failure.value).toBe(''), 2000)
    expect(known()).toEqual(kept())
  })

  it('take nothing away from what was done', async () => {
    await layers.apply(one)
    await another()
    await layers.undo()
    expect(layers.canUndo.value).toBe(true)
    expect(kept()).toEqual([['mine', [inWords(one)]]])
  })
})

describe('withLayer', () => {
  it('keeps layers by name, and none without edits', () => {
    const layers = withLayer([create(LayerSchema, { name: 'b', edits: [one] })], 'a', [two])
    expect(layers.map(({ name }) => name)).toEqual(['a', 'b'])
    expect(withLayer(layers, 'b', []).map(({ name }) => name)).toEqual(['a'])
  })
})
