// Keys, and what they do.

import type { Studio, Tool } from '../data/studio'
import { copyLink } from './links'

export type Command =
  | { kind: 'tool'; tool: Tool }
  | { kind: 'cancel' | 'follow' | 'another' | 'replay' | 'plots' | 'top' | 'frame' | 'graph' | 'names' | 'trails' }
  | { kind: 'link' | 'panel' | 'help' | 'undo' | 'redo' }

/** What of a keyboard event matters. */
export interface Stroke {
  key: string
  ctrl: boolean
  shift: boolean
  alt: boolean
  /** Whether it goes into a field that takes text, or to an open dialog. */
  typing: boolean
}

/** Tools of the rail with their keys, in order. */
export const TOOL_KEYS: readonly { key: string; tool: Tool; name: string }[] = [
  { key: '1', tool: 'select', name: 'Select' },
  { key: '2', tool: 'plan', name: 'Plan a path' },
  { key: '3', tool: 'forbid', name: 'Forbid an edge' },
  { key: '4', tool: 'add', name: 'Add a vertex' },
  { key: '5', tool: 'move', name: 'Move a vertex' },
  { key: '6', tool: 'remove', name: 'Remove a vertex' },
  { key: '7', tool: 'force', name: 'Force an edge' },
  { key: '8', tool: 'spawn', name: 'Spawn an NPC' },
  { key: '9', tool: 'player', name: 'Move a player' },
  { key: '0', tool: 'reach', name: 'Show what is reachable' },
]

/** Keys of the player while there is one. */
export const PLAYER_KEYS: readonly { keys: string; does: string }[] = [
  { keys: 'W A S D', does: 'Walk with the player' },
  { keys: 'Shift W', does: 'Run' },
]

/** All other keys, for the sheet. */
export const OTHER_KEYS: readonly { keys: string; does: string }[] = [
  { keys: 'Esc', does: 'Cancel the tool, clear the selection' },
  { keys: 'J', does: 'Follow another NPC' },
  { keys: 'F', does: 'Follow the selected NPC, or stay' },
  { keys: 'R', does: "Replay the NPC's last attempt" },
  { keys: 'M', does: 'Plots of its motion beside the replay' },
  { keys: 'T', does: 'Top view' },
  { keys: 'H', does: 'Show the whole map' },
  { keys: 'G', does: 'Graph bright or faint' },
  { keys: 'N', does: 'Names on or off' },
  { keys: 'L', does: 'Trails on or off' },
  { keys: 'C', does: 'Copy a link to this view' },
  { keys: 'P', does: 'Side panel on or off' },
  { keys: 'Ctrl Z', does: 'Undo an edit' },
  { keys: 'Ctrl Shift Z', does: 'Redo it' },
  { keys: '?', does: 'This help' },
]

const LETTERS: Record<string, Command> = {
  j: { kind: 'another' },
  f: { kind: 'follow' },
  r: { kind: 'replay' },
  m: { kind: 'plots' },
  t: { kind: 'top' },
  h: { kind: 'frame' },
  g: { kind: 'graph' },
  n: { kind: 'names' },
  l: { kind: 'trails' },
  c: { kind: 'link' },
  p: { kind: 'panel' },
}

export function commandFor({ key, ctrl, shift, alt, typing }: Stroke): Command | undefined {
  if (typing || alt) return undefined
  const letter = key.toLowerCase()
  if (ctrl) {
    if (letter === 'z') return { kind: shift ? 'redo' : 'undo' }
    return letter === 'y' ? { kind: 'redo' } : undefined
  }
  if (key === 'Escape') return { kind: 'cancel' }
  if (key === '?') return { kind: 'help' }
  const tool = TOOL_KEYS.find((entry) => entry.key === key)
  return tool === undefined ? LETTERS[letter] : { kind: 'tool', tool: tool.tool }
}

export function perform(studio: Studio, command: Command): void {
  const { view, layers, npcs, viewport } = studio
  switch (command.kind) {
    case 'tool':
      return studio.setTool(command.tool)
    case 'cancel':
      return cancel(studio)
    case 'follow':
      return npcs.toggleCamera()
    case 'another':
      return studio.followAnother()
    case 'replay':
      return studio.toggleReplay()
    case 'plots':
      return studio.togglePlots()
    case 'top':
      view.top.value = !view.top.value
      return
    case 'frame':
      return viewport.peek()?.frameMap()
    case 'graph':
      return studio.toggleGraph()
    case 'names':
      return view.setNames(!view.names.peek())
    case 'trails':
      view.trails.value = !view.trails.value
      return
    case 'link':
      return void copyLink(window, studio)
    case 'panel':
      studio.panelOpen.value = !studio.panelOpen.value
      return
    case 'help':
      studio.helpOpen.value = !studio.helpOpen.value
      return
    case 'undo':
      return void layers.undo()
    case 'redo':
      return void layers.redo()
  }
}

/** Takes one thing back after the other: the help, the replay, half an edge, the tool, the selection. */
export function cancel(studio: Studio): void {
  if (studio.helpOpen.value) studio.helpOpen.value = false
  else if (studio.replays.shown.value !== undefined) studio.replays.close()
  else if (studio.forceFrom.value !== undefined) studio.forceFrom.value = undefined
  else if (studio.tool.value !== 'select') studio.setTool('select')
  else if (studio.levels.selected.value !== undefined) studio.levels.selected.value = undefined
  else if (studio.graphs.selection.value !== undefined) studio.graphs.select(undefined)
  else studio.npcs.select(undefined)
}

export const TEXT_FIELDS = 'input:not([type=checkbox]):not([type=radio]):not([type=range]), select, textarea, dialog'

export function listenToKeys(target: Window, studio: Studio): void {
  target.addEventListener('keydown', (event) => {
    const command = commandFor({
      key: event.key,
      ctrl: event.ctrlKey || event.metaKey,
      shift: event.shiftKey,
      alt: event.altKey,
      typing: event.target instanceof Element && event.target.closest(TEXT_FIELDS) !== null,
    })
    if (command === undefined) return
    event.preventDefault()
    perform(studio, command)
  })
}
