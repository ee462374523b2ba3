import { describe, expect, it } from 'vitest'
import { AddressError, parseAddress, plannerNamedIn } from '../../src/data/net/address'

const page = new URL('http://127.0.0.1:7600/?x=1')

describe('parseAddress', () => {
  it.each([
    [':9000', 'https://games.example/studio/', 'https://games.example:9000', 'https://games.example:9000'],
    [':7601', 'http://[::1]:7600/', 'http://[::1]:7601', 'http://[::1]:7601'],
    [' https://plans.example/ ', page.href, 'https://plans.example', 'https://plans.example'],
    ['https://games.example/planner//', page.href, 'https://games.example/planner', 'https://games.example'],
    ['http://other:1/?a=b#c', page.href, 'http://other:1', 'http://other:1'],
    // What looks like another name is shown as what it is.
    ['https://plаns.example', page.href, 'https://xn--plns-63d.example', 'https://xn--plns-63d.example'],
    ['HTTPS://PLANS.example:443\\..', page.href, 'https://plans.example', 'https://plans.example'],
  ])('reads %s on %s as %s', (text, on, url, origin) => {
    expect(parseAddress(text, new URL(on))).toEqual({ url, origin })
  })

  it.each([
    ['ftp://plans.example', 'only http: and https:'],
    ['javascript:alert(1)', 'only http: and https:'],
    ['data:text/plain,hi', 'only http: and https:'],
    ['plans.example:7601', 'only http: and https:'],
    ['//plans.example', 'not a complete address'],
    ['/planner', 'not a complete address'],
    [':99999', 'not a complete address'],
    ['http://127.0.0.1:7601@evil.example', 'a user name or a password'],
    ['http://:secret@evil.example', 'a user name or a password'],
  ])('refuses %s', (text, why) => {
    expect(() => parseAddress(text, page)).toThrow(AddressError)
    expect(() => parseAddress(text, page)).toThrow(why)
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
