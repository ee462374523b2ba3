import { create } from '@bufbuild/protobuf'
import { describe, expect, it } from 'vitest'
import { boxOnMap, cut, findNodes, geometryRows, inOrder, nodeName, summaryOf } from '../../src/data/world/report'
import { GeometryCountsSchema, ImportedNodeSchema, NodeRole, UpAxis } from '../../src/gen/surefoot/world/v1/maps_pb'
import { edgesOf } from '../../src/view/outline'

const node = (index: number, name: string, role: NodeRole) => create(ImportedNodeSchema, { index, name, role })

const NODES = [
  node(0, '', NodeRole.EMPTY),
  node(1, 'hall', NodeRole.SOLID),
  node(2, 'Waterfront', NodeRole.WATER),
  node(3, '', NodeRole.SOLID),
  node(4, 'door_1', NodeRole.DOOR),
  node(5, 'door_2', NodeRole.DOOR),
  node(6, 'Sky', NodeRole.LEFT_OUT),
]
const indices = (nodes: readonly { index: number }[]) => nodes.map(({ index }) => index)

describe('the report of an import', () => {
  it('counts nodes by role', () => {
    expect(summaryOf(NODES)).toBe('7 nodes: 2 solid, 1 water, 2 doors, 1 left out, 1 empty')
    expect(summaryOf([NODES[4]!])).toBe('1 node: 1 door')
    expect(summaryOf([])).toBe('0 nodes')
    expect(summaryOf([node(0, 'new', 99 as NodeRole)])).toBe('1 node: 1 unknown')
  })

  it('lists first what is not solid, and last what is nothing', () => {
    expect(indices(inOrder(NODES))).toEqual([2, 4, 5, 6, 1, 3, 0])
  })

  it('keeps lines in their places when roles change', () => {
    const before = inOrder(NODES)
    const after = NODES.map((it) => node(it.index, it.name, NodeRole.SOLID))
    expect(indices(inOrder(after, before))).toEqual(indices(before))
    expect(indices(inOrder([...after, node(7, 'lava', NodeRole.LAVA)], before)).at(-1)).toBe(7)
  })

  it.each([
    ['a part of a name', { text: 'DOOR', role: undefined }, [4, 5]],
    ['the number of a node without a name', { text: 'node 3', role: undefined }, [3]],
    ['a role', { text: '', role: NodeRole.SOLID }, [1, 3]],
    ['both', { text: 'hall', role: NodeRole.DOOR }, []],
  ])('is searched by %s', (_, filter, expected) => {
    expect(indices(findNodes(NODES, filter, undefined))).toEqual(expected)
  })

  it('does not lose the selected line to a filter', () => {
    expect(indices(findNodes(NODES, { text: '', role: NodeRole.DOOR }, 2))).toEqual([2, 4, 5])
  })

  it('names and cuts', () => {
    expect([nodeName(NODES[0]!), nodeName(NODES[1]!)]).toEqual(['node 0', 'hall'])
    expect([cut('hall', 4), cut('halls', 4)]).toEqual(['hall', 'hal…'])
    // A character of two units is not torn.
    expect(cut('🏠'.repeat(9), 4)).toBe('🏠🏠🏠…')
    expect(cut('x'.repeat(1_000_000), 60)).toHaveLength(60)
  })

  it('shows counts of the geometry that are not zero', () => {
    const counts = create(GeometryCountsSchema, { triangles: 1200n, openEdges: 4n })
    expect(geometryRows(counts)).toEqual([
      ['Solid triangles', '1,200'],
      ['Open edges', '4'],
    ])
    expect(geometryRows(undefined)).toEqual([])
  })

  it('finds nodes on the map, whichever axis is up', () => {
    const corners = { low: { x: 100, y: -300, z: 0 }, high: { x: 200, y: -100, z: 250 } }
    const box = create(ImportedNodeSchema, corners)
    const origin = { x: 2, y: 1, z: 32 }
    expect(boxOnMap(box, { origin, scale: 0.01, up: UpAxis.Z })).toEqual({
      low: { x: 3, y: 1, z: 33 },
      high: { x: 4, y: 3.5, z: 35 },
    })
    expect(boxOnMap(box, { origin, scale: 1, up: UpAxis.Y })).toEqual({
      low: { x: 102, y: -299, z: 32 },
      high: { x: 202, y: -99, z: 282 },
    })
    expect(boxOnMap(node(0, '', NodeRole.EMPTY), { origin, scale: 1, up: UpAxis.Y })).toBeUndefined()
  })

  it('outlines a box by its twelve edges', () => {
    const edges = edgesOf({ low: { x: 0, y: 0, z: 0 }, high: { x: 1, y: 2, z: 3 } })
    const lengths = edges.map(([a, b]) => Math.hypot(a.x - b.x, a.y - b.y, a.z - b.z).toFixed(1)).sort()
    expect(lengths).toEqual([...Array(4).fill('1.1'), ...Array(4).fill('2.1'), ...Array(4).fill('3.1')])
  })
})
