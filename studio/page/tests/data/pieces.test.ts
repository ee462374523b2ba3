import { create } from '@bufbuild/protobuf'
import { createClient, createRouterTransport } from '@connectrpc/connect'
import { describe, expect, it } from 'vitest'
import type { Context } from '../../src/data/context'
import { Link } from '../../src/data/net/link'
import { Session } from '../../src/data/net/session'
import { Toasts } from '../../src/data/toasts'
import { changedBox, freeName, pieceBetween, Pieces } from '../../src/data/world/pieces'
import { MapService } from '../../src/gen/surefoot/world/v1/maps_pb'
import { type Piece, PieceSchema } from '../../src/gen/surefoot/world/v1/piece_pb'
import { WorldService } from '../../src/gen/surefoot/world/v1/world_pb'
import type { Box } from '../../src/view/viewport.types'

const at = (x: number, y: number, z: number) => ({ x, y, z })
const SIZES = { width: 4, height: 3 }

/** A server with one world, on whose map there are these pieces. */
function server(): { context: Context; laid: Map<string, Piece>; asked: () => number } {
  const laid = new Map<string, Piece>()
  let [revision, asked] = [0n, 0]
  const transport = createRouterTransport(({ service }) => {
    service(WorldService, {
      listPieces: () => {
        asked += 1
        return { pieces: [...laid.values()], mapRevision: revision, editedMapHash: `hash ${revision}` }
      },
      editMap: ({ put, remove, clear }) => {
        revision += 1n
        if (clear) laid.clear()
        for (const name of remove) laid.delete(name)
        for (const piece of put) laid.set(piece.name, piece)
        return { mapRevision: revision, movedNpcIds: clear ? [1n, 2n] : [] }
      },
    })
  })
  const session = new Session('http://127.0.0.1:7600', undefined)
  const side = { address: '', isForeign: false, session, link: new Link(), maps: createClient(MapService, transport) }
  const context: Context = {
    world: { ...side, calls: createClient(WorldService, transport) },
    planner: {} as Context['planner'],
    toasts: new Toasts(),
    store: undefined,
    signal: new AbortController().signal,
  }
  return { context, laid, asked: () => asked }
}

describe('a piece', () => {
  it('stands where one clicked, or lies between two clicks', () => {
    const block = pieceBetween('block', 'b', at(1, 2, 3), at(1, 2, 3), SIZES)
    expect(block.shape).toMatchObject({ case: 'block', value: { foot: at(1, 2, 3), width: 4, depth: 4, height: 3 } })
    const bridge = pieceBetween('bridge', 'b', at(0, 1, 0), at(9, 4, 0), SIZES)
    expect(bridge.shape.case === 'plank' && bridge.shape.value.to?.y).toBeCloseTo(4.05)
    const lava = pieceBetween('lava', 'l', at(8, 1, 2), at(2, 1.5, 6), SIZES)
    // It covers both corners.
    expect(lava.shape).toMatchObject({ case: 'pool', value: { halfX: 3, halfZ: 2, lava: true } })
    if (lava.shape.case !== 'pool') throw new Error('no pool')
    expect([lava.shape.value.centre?.x, lava.shape.value.centre?.y, lava.shape.value.centre?.z]).toEqual([5, 1.8, 4])
    expect(lava.shape.value.depth).toBeCloseTo(2.8)
  })

  it('gets a name that no other has', () => {
    const named = (name: string) => create(PieceSchema, { name })
    expect(freeName('block', [])).toBe('block 1')
    expect(freeName('block', [named('block 1'), named('lava 2'), named('block 3')])).toBe('block 2')
  })

  it('changes the map around where it was and where it is', () => {
    const here = pieceBetween('block', 'b', at(10, 0, 10), at(10, 0, 10), SIZES)
    const there = pieceBetween('block', 'b', at(50, 0, 10), at(50, 0, 10), SIZES)
    const other = pieceBetween('bridge', 'c', at(90, 0, 90), at(99, 0, 90), SIZES)
    expect(changedBox([here, other], [here, other])).toBeUndefined()
    const box = changedBox([here, other], [there, other])
    expect([box?.low.x, box?.high.x].map((x) => Math.round(x ?? 0))).toEqual([7, 53])
    expect(box?.high.z).toBeLessThan(14)
  })
})

describe('pieces', () => {
  it('are placed by one click or two, and the map is drawn again there', async () => {
    const { context, laid } = server()
    const boxes: Box[] = []
    const pieces = new Pieces(context, (box) => boxes.push(box))
    const { signal } = new AbortController()
    await pieces.load(1n, signal)
    expect(pieces.laid.value?.mapHash).toBe('hash 0')
    await pieces.click(1n, at(5, 0, 5))
    pieces.choose('bridge')
    await pieces.click(1n, at(10, 0, 5))
    expect([...laid.keys()]).toEqual(['block 1'])
    expect(pieces.begun.value).toEqual(at(10, 0, 5))
    await pieces.click(1n, at(20, 0, 5))
    expect([...laid.keys()]).toEqual(['block 1', 'bridge 1'])
    expect(pieces.begun.value).toBeUndefined()
    await pieces.take(1n, 2n, signal)
    expect(pieces.laid.value?.pieces).toHaveLength(2)
    expect(boxes).toHaveLength(1)
    await pieces.remove(1n, 'block 1')
    expect([...laid.keys()]).toEqual(['bridge 1'])
  })

  it('are asked for only when the map has another revision', async () => {
    const { context, asked } = server()
    const pieces = new Pieces(context, () => undefined)
    const { signal } = new AbortController()
    await pieces.load(1n, signal)
    await pieces.take(1n, 0n, signal)
    await pieces.take(1n, 0n, signal)
    expect(asked()).toBe(1)
    await pieces.take(1n, 1n, signal)
    expect(asked()).toBe(2)
  })

  it('say when NPCs had to step aside', async () => {
    const { context } = server()
    const pieces = new Pieces(context, () => undefined)
    await pieces.clear(1n)
    expect(context.toasts.shown.value.map(({ text }) => text)).toEqual(['2 NPCs had to step aside.'])
  })
})
