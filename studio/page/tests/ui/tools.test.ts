import { describe, expect, it } from 'vitest'
import { TOOL_KEYS } from '../../src/ui/keys'
import { EDIT_TOOLS } from '../../src/data/studio'
import { PICKABLE } from '../../src/ui/tools'

describe('tools', () => {
  it.each([
    ['select', undefined],
    ['plan', ['ground', 'vertex']],
    ['forbid', ['edge']],
    ['add', ['ground']],
    ['move', ['vertex']],
    ['remove', ['vertex']],
    ['force', ['vertex']],
    ['spawn', ['ground', 'vertex']],
    ['player', ['ground', 'npc']],
    ['reach', ['ground', 'vertex']],
  ] as const)('%s meets %s', (tool, kinds) => {
    expect(PICKABLE[tool]).toEqual(kinds === undefined ? undefined : new Set(kinds))
  })

  it('that edit can all be reached by a key', () => {
    const reached = new Set(TOOL_KEYS.map(({ tool }) => tool))
    expect([...EDIT_TOOLS].filter((tool) => !reached.has(tool))).toEqual([])
  })
})
