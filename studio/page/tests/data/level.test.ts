import { createClient, createRouterTransport } from '@connectrpc/connect'
import { beforeEach, describe, expect, it, vi } from 'vitest'
import type { Context } from '../../src/data/context'
import { Link } from '../../src/data/net/link'
import { Session } from '../../src/data/net/session'
import { Toasts } from '../../src/data/toasts'
import { Level, type LevelSink } from '../../src/data/world/level'
import { MapService } from '../../src/gen/surefoot/world/v1/maps_pb'
import { WorldService } from '../../src/gen/surefoot/world/v1/world_pb'

/** Regions of full detail that were asked for. */
let asked: number
let fine: Set<string>

const transport = createRouterTransport(({ service }) => {
  service(WorldService, {
    getFeatures: () => ({ size: { width: 640, height: 80, depth: 640 } }),
    async *getMesh({ region }) {
      if (region === undefined) return
      asked += 1
      // All but the tile at the corner are empty, and are not sent.
      yield { tileX: 0, tileZ: 0, tileCount: 1 }
    },
  })
})

function contextFor(): Context {
  const session = new Session('http://127.0.0.1:7600', undefined)
  const side = { address: '', isForeign: false, session, link: new Link(), maps: createClient(MapService, transport) }
  return {
    world: { ...side, calls: createClient(WorldService, transport) },
    planner: {} as Context['planner'],
    toasts: new Toasts(),
    store: undefined,
    signal: new AbortController().signal,
  }
}

const sink: LevelSink = {
  clear: () => undefined,
  setFeatures: () => undefined,
  putTile: ({ tileX, tileZ }, isFine) => {
    if (isFine) fine.add(`${tileX},${tileZ}`)
  },
  dropTile: () => undefined,
  fineTiles: () => fine,
}

const pause = () => new Promise((resolve) => setTimeout(resolve, 50))

describe('full detail', () => {
  const corner = { x: 10, y: 0, z: 10 }
  let level: Level

  beforeEach(async () => {
    asked = 0
    fine = new Set()
    level = new Level(contextFor())
    void level.load(1n, sink, new AbortController().signal)
    await vi.waitFor(() => expect(level.state.value.kind).toBe('ready'))
  })

  it('is requested once, though tiles are empty', async () => {
    level.want(corner, 100)
    await pause()
    expect(asked).toBe(1)
  })

  it('is requested once, though a tile has to give way at once', async () => {
    sink.putTile = () => undefined
    level.want(corner, 20)
    await pause()
    expect(asked).toBe(1)
  })

  it('is requested again with the next wish', async () => {
    level.want(corner, 100)
    await pause()
    level.want(corner, 101)
    await pause()
    expect(asked).toBe(2)
  })

  it('is requested where the camera went meanwhile', async () => {
    level.want(corner, 100)
    level.want({ x: 600, y: 0, z: 600 }, 20)
    await pause()
    expect(asked).toBeGreaterThanOrEqual(1)
    level.want({ x: 600, y: 0, z: 600 }, 20)
    await pause()
    const before = asked
    await pause()
    expect(asked).toBe(before)
  })
})

describe('an edited map', () => {
  it('is drawn again where it was edited, and empty tiles are removed', async () => {
    const [put, dropped]: string[][] = [[], []]
    const drawn: LevelSink = {
      ...sink,
      putTile: ({ tileX, tileZ }) => put?.push(`${tileX},${tileZ}`),
      dropTile: (key) => dropped?.push(key),
    }
    const level = new Level(contextFor())
    const { signal } = new AbortController()
    void level.load(1n, drawn, signal)
    await vi.waitFor(() => expect(level.state.value.kind).toBe('ready'))
    await level.redraw(1n, drawn, { low: { x: 60, y: 0, z: 10 }, high: { x: 70, y: 9, z: 20 } }, signal)
    expect(put).toEqual(['0,0'])
    expect(dropped).toEqual(['1,0'])
  })
})
