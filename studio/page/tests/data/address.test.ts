import { describe, expect, it } from 'vitest'
import { plannerAddress, plannerNamedIn, worldAddress } from '../../src/data/net/address'

describe('worldAddress', () => {
  it.each([
    ['http://127.0.0.1:7600/', 'http://127.0.0.1:7600'],
    ['https://games.example/studio/index.html', 'https://games.example'],
    ['http://localhost:5173/?server=http://10.0.0.7:7600/', 'http://10.0.0.7:7600'],
  ])('of %s is %s', (page, address) => {
    expect(worldAddress(new URL(page))).toBe(address)
  })
})

describe('plannerAddress', () => {
  it.each([
    [undefined, 'http://127.0.0.1:7600/', 'http://127.0.0.1:7601'],
    ['', 'http://127.0.0.1:7600/', 'http://127.0.0.1:7601'],
    [':9000', 'https://games.example/studio/', 'https://games.example:9000'],
    [':7601', 'http://[::1]:7600/', 'http://[::1]:7601'],
    ['https://plans.example/', 'http://127.0.0.1:7600/', 'https://plans.example'],
    [':9000', 'http://127.0.0.1:7600/?planner=:9001', 'http://127.0.0.1:9001'],
    [':9000', 'http://127.0.0.1:7600/?planner=http://other:1', 'http://other:1'],
  ])('named %s on %s is %s', (named, page, address) => {
    expect(plannerAddress(named, new URL(page))).toBe(address)
  })
})

describe('plannerNamedIn', () => {
  it.each([
    [{ planner: ':7601' }, ':7601'],
    [{ planner: 7601 }, undefined],
    [{}, undefined],
    [null, undefined],
    ['planner', undefined],
  ])('%j says %s', (json, named) => {
    expect(plannerNamedIn(json)).toBe(named)
  })
})
