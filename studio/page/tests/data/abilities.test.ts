import { describe, expect, it } from 'vitest'
import { Standing } from '../../src/gen/surefoot/world/v1/world_pb'
import { standingReason } from '../../src/data/abilities'

describe('standingReason', () => {
  it('has a text for every reason, and none for an NPC that moves', () => {
    const reasons = Object.values(Standing).filter((reason) => typeof reason === 'number')
    const withText = reasons.filter((reason) => standingReason(reason) !== '')
    expect(withText).toEqual(reasons.filter((reason) => reason !== Standing.UNSPECIFIED))
  })

  it('has no text for a reason of a later server', () => {
    expect(standingReason(99 as Standing)).toBe('')
  })
})
