import { describe, expect, it } from 'vitest'
import { commandFor, OTHER_KEYS, TOOL_KEYS } from '../../src/ui/keys'

const stroke = (text: string, typing = false) => {
  const parts = text.split(' ')
  return {
    key: parts.at(-1) ?? '',
    ctrl: parts.includes('Ctrl'),
    shift: parts.includes('Shift'),
    alt: parts.includes('Alt'),
    typing,
  }
}

describe('commandFor', () => {
  it.each([
    ['1', { kind: 'tool', tool: 'select' }],
    ['2', { kind: 'tool', tool: 'plan' }],
    ['7', { kind: 'tool', tool: 'force' }],
    ['9', { kind: 'tool', tool: 'player' }],
    ['0', { kind: 'tool', tool: 'reach' }],
    ['f', { kind: 'follow' }],
    ['Shift F', { kind: 'follow' }],
    ['t', { kind: 'top' }],
    ['h', { kind: 'frame' }],
    ['g', { kind: 'graph' }],
    ['Shift ?', { kind: 'help' }],
    ['Escape', { kind: 'cancel' }],
    ['Ctrl z', { kind: 'undo' }],
    ['Ctrl Shift Z', { kind: 'redo' }],
    ['Ctrl y', { kind: 'redo' }],
    ['Ctrl f', undefined],
    ['Alt t', undefined],
    ['x', undefined],
  ])('%s', (text, command) => {
    expect(commandFor(stroke(text))).toEqual(command)
  })

  it.each(['1', 'f', 'Ctrl z', 'Escape', '?'])('leaves %s to a field that is typed into', (text) => {
    expect(commandFor(stroke(text, true))).toBeUndefined()
  })

  it('has a key of its own for each tool', () => {
    expect(new Set(TOOL_KEYS.map(({ key }) => key)).size).toBe(TOOL_KEYS.length)
  })

  it.each(OTHER_KEYS.map(({ keys }) => [keys === 'Esc' ? 'Escape' : keys]))(
    'does what the sheet says for %s',
    (keys) => {
      expect(commandFor(stroke(keys))).toBeDefined()
    },
  )
})
