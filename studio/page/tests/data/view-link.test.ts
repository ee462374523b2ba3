import { describe, expect, it } from 'vitest'
import { decodeLink, encodeLink, type ViewLink } from '../../src/data/view-link'

const plain: ViewLink = {
  world: { id: 7n, map: '021960cb' },
  follows: false,
  top: false,
  graph: 'faint',
  colour: 'chance',
  trails: true,
  names: true,
}

const full: ViewLink = {
  world: { id: 18446744073709551615n, map: '021960cb' },
  camera: { distance: 17.5, azimuth: -3.43, polar: 1.12, target: { x: 1.25, y: -2, z: 300 } },
  npc: 1954915225534726160n,
  follows: true,
  top: true,
  graph: 'full',
  colour: 'traffic',
  trails: false,
  names: false,
  section: 12.5,
  start: { x: 0, y: 1, z: 2 },
  goal: { x: 3, y: 4, z: 5.55 },
}

describe('a link', () => {
  it.each<[string, ViewLink]>([
    ['of a plain view', plain],
    ['of everything', full],
    ['with a camera that follows', { ...full, camera: { distance: 17.5, azimuth: 1, polar: 1 } }],
  ])('%s names the same view after it was written', (_, link) => {
    expect(decodeLink(`#${encodeLink(link)}`)).toEqual(link)
  })

  it('is short and can be read by people', () => {
    expect(encodeLink(plain)).toBe('world=7.021960cb')
    const camera = { distance: 17.123456, azimuth: 0.5, polar: 1, target: { x: 10.001, y: 2, z: 3 } }
    expect(encodeLink({ ...plain, camera })).toBe('world=7.021960cb&camera=17.12,0.5,1&at=10,2,3')
  })

  it.each(['', '#', '#section', '#world=x', '#world=1', '#world=1.', '#world=-1.ab', '#world=1.<b>'])(
    'names no view: %s',
    (hash) => {
      expect(decodeLink(hash)).toBeUndefined()
    },
  )

  it.each<[string, Partial<ViewLink>]>([
    ['camera=1,2', {}],
    ['camera=NaN,1,1', {}],
    ['camera=,1,1', {}],
    ['camera=0,1,9', { camera: { distance: 2.5, azimuth: 1, polar: Math.PI / 2 } }],
    ['at=1,2,3', {}],
    ['camera=10,1,1&at=1,2,1e99', { camera: { distance: 10, azimuth: 1, polar: 1 } }],
    ['npc=x&follow=1', {}],
    ['follow=1', {}],
    ['graph=huge&colour=pink&section=high', {}],
    ['start=1,2&goal=1,2,3', { goal: { x: 1, y: 2, z: 3 } }],
  ])('leaves out what cannot be read: %s', (rest, expected) => {
    expect(decodeLink(`#world=7.021960cb&${rest}`)).toEqual({ ...plain, ...expected })
  })
})
