import { describe, expect, it } from 'vitest'
import { kindOf, nameFault, readSidecar, withKind, withNames, writeSidecar } from '../../src/data/world/sidecar'

const LISTED = { pads: [{ at: [1, 2, 3] }], nodes: { 'fx_*': 'leave_out', Waterfront: 'solid' }, of_tomorrow: [1] }

describe('the sidecar', () => {
  it('says what the node of exactly a name is, in any case', () => {
    const sidecar = readSidecar(JSON.stringify(LISTED))
    expect(kindOf(sidecar, 'WATERFRONT')).toBe('solid')
    // A pattern is no entry of the node's own.
    expect(kindOf(sidecar, 'fx_smoke')).toBeUndefined()
    expect(kindOf(readSidecar(''), 'Waterfront')).toBeUndefined()
  })

  it('gets one entry for a node, and keeps all else', () => {
    const sidecar = readSidecar(JSON.stringify(LISTED))
    const switched = withKind(sidecar, 'waterfront', 'door')
    expect(switched).toEqual({ ...LISTED, nodes: { 'fx_*': 'leave_out', waterfront: 'door' } })
    expect(withKind(switched, 'Waterfront', undefined)).toEqual({ ...LISTED, nodes: { 'fx_*': 'leave_out' } })
    expect(sidecar).toEqual(LISTED)
  })

  it('has no list once its last entry is taken back', () => {
    expect(withKind(withKind({}, 'hall', 'water'), 'hall', undefined)).toEqual({})
  })

  it('takes any name as it is', () => {
    for (const name of ['__proto__', 'constructor', '"><img src=x onerror=alert(1)>', '12']) {
      const written = readSidecar(writeSidecar(withKind({}, name, 'lava')))
      expect(kindOf(written, name)).toBe('lava')
      expect(Object.keys(written.nodes!)).toEqual([name])
    }
  })

  it('denies that names have a meaning, and no longer', () => {
    const denied = withNames(readSidecar('{"movers": []}'), false)
    expect(denied).toEqual({ movers: [], names: false })
    expect(withNames(denied, true)).toEqual({ movers: [] })
  })

  it.each([
    ['', /has no name/],
    ['fx_*', /is a pattern/],
    ['*_lod', /is a pattern/],
  ])('cannot refer to a node called "%s"', (name, why) => {
    expect(nameFault(name)).toMatch(why)
  })

  it('can refer to any other', () => {
    expect([nameFault('Water*front'), nameFault(' ')]).toEqual([undefined, undefined])
  })
})
