import { describe, expect, it } from 'vitest'
import { Tour, TOUR_STEPS, type TourFacts } from '../../src/data/tour'

const facts = (changes: Partial<TourFacts> = {}): TourFacts => ({
  looks: 3,
  follows: 1n,
  plan: 'a',
  sent: 2,
  forbidden: 1,
  ...changes,
})

function store() {
  const kept = new Map<string, string>()
  return {
    getItem: (key: string) => kept.get(key) ?? null,
    setItem: (key: string, value: string) => void kept.set(key, value),
  }
}

describe('Tour', () => {
  it('is offered once, whether it is taken or not', () => {
    const kept = store()
    const first = new Tour(kept)
    first.offer()
    expect(first.isOffered.value).toBe(true)
    first.end()
    expect(first.isOffered.value).toBe(false)
    const second = new Tour(kept)
    second.offer()
    expect(second.isOffered.value).toBe(false)
    second.start()
    expect(second.step.value?.name).toBe('look')
  })

  it('is not offered where the browser keeps nothing, since it would be offered each time', () => {
    const tour = new Tour(undefined)
    tour.offer()
    expect(tour.isOffered.value).toBe(false)
  })

  it.each<[string, Partial<TourFacts>, Partial<TourFacts>]>([
    ['look', { looks: 20 }, { looks: 8 }],
    ['follow', { follows: 2n }, { follows: undefined }],
    ['plan', { plan: 'b' }, { plan: undefined }],
    ['send', { sent: 3 }, { follows: 9n }],
    ['forbid', { forbidden: 2 }, { forbidden: 0 }],
    ['undo', { forbidden: 0 }, { forbidden: 2 }],
  ])('step %s is done by doing the thing, and by nothing else', (name, doing, other) => {
    const tour = new Tour(store())
    tour.at.value = TOUR_STEPS.findIndex((step) => step.name === name)
    tour.take(facts())
    tour.take(facts(other))
    expect(tour.isDone.value).toBe(false)
    tour.take(facts(doing))
    expect(tour.isDone.value).toBe(true)
  })

  it('begins each step with what is known then', () => {
    const tour = new Tour(store())
    tour.start()
    tour.take(facts())
    tour.take(facts({ looks: 99 }))
    expect(tour.isDone.value).toBe(true)
    tour.next()
    expect([tour.step.value?.name, tour.isDone.value]).toEqual(['follow', false])
    tour.take(facts({ follows: 2n }))
    expect(tour.isDone.value).toBe(false)
    tour.take(facts({ follows: 3n }))
    expect(tour.isDone.value).toBe(true)
  })

  it('goes back and on, and ends after its last card', () => {
    const tour = new Tour(store())
    tour.start()
    tour.back()
    expect(tour.at.value).toBe(0)
    for (let step = 0; step < TOUR_STEPS.length; step += 1) tour.next()
    expect([tour.at.value, tour.step.value]).toEqual([TOUR_STEPS.length, undefined])
    tour.back()
    expect(tour.step.value?.name).toBe('undo')
    tour.next()
    tour.next()
    expect(tour.at.value).toBeUndefined()
    tour.take(facts())
    expect(tour.isDone.value).toBe(false)
  })
})
