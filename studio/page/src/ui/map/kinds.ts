// Kinds of ground and bodies to choose from.

import type { Body } from '../../gen/surefoot/world/v1/body_pb'
import { MapKind } from '../../gen/surefoot/world/v1/map_pb'

export const KINDS = [
  { value: String(MapKind.TERRAIN), name: 'Terrain' },
  { value: String(MapKind.OPEN), name: 'Open terrain' },
  { value: String(MapKind.ISLANDS), name: 'Islands' },
  { value: String(MapKind.INTERIOR), name: 'Interior' },
  { value: String(MapKind.ARENA), name: 'Arena' },
  { value: String(MapKind.TOWER), name: 'Towers' },
  { value: String(MapKind.KEEP), name: 'Keeps' },
  { value: String(MapKind.FLOODED), name: 'Flooded caves' },
  { value: String(MapKind.VENTS), name: 'Vents' },
  { value: String(MapKind.ROOFTOPS), name: 'Rooftops' },
  { value: String(MapKind.CANYON), name: 'Canyon' },
] as const

/** Presets of bodies, as the contract names them; the first is what worlds have unless told otherwise. */
export const BODIES = [
  { value: 'surefoot', name: "Surefoot's" },
  { value: 'unreal', name: 'Unreal' },
  { value: 'godot', name: 'Godot' },
  { value: 'unity', name: 'Unity' },
  { value: 'heavy', name: 'Heavy' },
  { value: 'small', name: 'Small' },
  { value: 'climber', name: 'Climber' },
] as const

export type KindValue = (typeof KINDS)[number]['value']
export type BodyName = (typeof BODIES)[number]['value']

/** What a body is called: its preset, or what it measures. */
export function bodyName(body: Pick<Body, 'preset' | 'height' | 'forwardSpeed'>): string {
  const preset = BODIES.find(({ value }) => value === body.preset)
  if (preset !== undefined) return preset.name
  return `${(body.height ?? 0).toFixed(2)} m, ${(body.forwardSpeed ?? 0).toFixed(1)} m/s`
}
