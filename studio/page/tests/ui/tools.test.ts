import { describe, expect, it } from 'vitest'
import { groundOf } from '../../src/ui/tools'

const places = [
  { x: 0, y: 0, z: 0 },
  { x: 10, y: 2, z: 0 },
]
const position = (vertex: number) => places[vertex] as never
const studio = { graphs: { position } } as never

describe('groundOf', () => {
  const at = { x: 3, y: 6, z: 0 }
  it.each([
    ['nothing', undefined, undefined],
    ['ground', { kind: 'ground', at, surface: 1 }, at],
    ['an NPC', { kind: 'npc', id: 1n, at }, at],
    ['a vertex', { kind: 'vertex', index: 1, at: places[1] }, places[1]],
    ['an edge, near its beginning', { kind: 'edge', from: 0, to: 1, at }, places[0]],
    ['an edge, near its end', { kind: 'edge', from: 0, to: 1, at: { x: 8, y: 6, z: 0 } }, places[1]],
    ['an edge with one end that is known', { kind: 'edge', from: 7, to: 1, at }, places[1]],
  ])('of %s', (_, hit, place) => {
    expect(groundOf(studio, hit as never)).toEqual(place)
  })
})
