import { describe, expect, it } from 'vitest'
import { Surface } from '../../src/gen/surefoot/world/v1/world_pb'
import { type Candidate, chooseHit, pickPoint, ProjectedLines, Projector } from '../../src/view/picking'
import type { Hit } from '../../src/view/viewport.types'
import { at } from './builders'

/** Looks along -z from the origin; one metre is 100 pixels at one metre. */
const projector = new Projector([1, 0, 0, 0, 0, 1, 0, 0, 0, 0, -1, -1, 0, 0, 0, 0], 200, 200)
const pointer = { x: 100, y: 100, reach: 10 }
const npc: Hit = { kind: 'npc', id: 3n, at: at(0, 0, 0) }
const vertex: Hit = { kind: 'vertex', index: 1, at: at(0, 0, 0) }
const door: Hit = { kind: 'mover', index: 0, at: at(0, 0, 0) }
const edge: Hit = { kind: 'edge', from: 0, to: 1, at: at(0, 0, 0) }
const ground = { distance: 20, at: at(0, 0, -20), surface: Surface.GROUND, outside: true }

describe('Projector', () => {
  it('takes places to pixels, and nothing from behind', () => {
    expect(projector.project(1, 0.5, -2)).toEqual({ x: 150, y: 75, depth: 2 })
    expect(projector.project(0, 0, 1)).toBeUndefined()
  })
})

describe('chooseHit', () => {
  const near = (hit: Hit, pixels: number, depth = 10): Candidate => ({ hit, pixels, depth })
  it.each<[string, Candidate[], boolean, Hit['kind'] | undefined]>([
    ['an NPC before a nearer vertex', [near(vertex, 1), near(npc, 8)], true, 'npc'],
    ['a vertex before a nearer edge', [near(edge, 0), near(vertex, 8)], true, 'vertex'],
    ['a door before a nearer edge', [near(edge, 0), near(door, 8)], true, 'mover'],
    ['an edge before the ground', [near(edge, 9)], true, 'edge'],
    ['the ground', [], true, 'ground'],
    ['nothing', [], false, undefined],
    ['not what the ground hides', [near(npc, 0, 30)], true, 'ground'],
    ['what stands in the ground a little', [near(npc, 0, 21)], true, 'npc'],
    ['what stands before the sky', [near(npc, 0, 500)], false, 'npc'],
  ])('%s', (_, candidates, hasGround, kind) => {
    expect(chooseHit(candidates, hasGround ? ground : undefined, 20)?.kind).toBe(kind)
  })

  it('takes the nearest of a kind', () => {
    const other: Hit = { kind: 'npc', id: 8n, at: at(0, 0, 0) }
    expect(chooseHit([near(npc, 6), near(other, 2)], ground, 20)).toBe(other)
  })
})

describe('pickPoint', () => {
  it.each([
    ['within reach', at(0.9, 0, -10), 0, 1],
    ['out of reach', at(1.1, 0, -10), 0, 0],
    ['large on the screen', at(1.1, 0, -10), 1.5, 1],
    ['behind the camera', at(0, 0, 10), 1, 0],
  ])('%s', (_, place, radius, count) => {
    expect(pickPoint([{ place, radius, hit: npc }], pointer, projector, 100)).toHaveLength(count)
  })
})

describe('ProjectedLines', () => {
  const line = (points: number[]): ProjectedLines =>
    new ProjectedLines([{ points, hit: (place) => ({ ...edge, at: place }) }], projector, 5)

  it('finds the place on the line', () => {
    const [met] = line([-2, 0.5, -10, 2, 0.5, -10]).pick(pointer)
    expect(met?.pixels).toBeCloseTo(5, 4)
    expect(met?.depth).toBeCloseTo(10, 4)
    expect(met?.hit.at.x).toBeCloseTo(0, 4)
  })

  it.each([
    ['too far off', [-2, 2, -10, 2, 2, -10]],
    ['behind the camera', [-2, 0, 10, 2, 0, 10]],
    ['above the section', [-2, 6, -10, 2, 6, -10]],
    ['ending before', [-9, 0, -10, -5, 0, -10]],
  ])('passes a line %s', (_, points) => {
    expect(line(points).pick(pointer)).toHaveLength(0)
  })
})
