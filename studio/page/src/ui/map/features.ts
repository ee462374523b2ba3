// Features that a generated map may have.

export const FEATURES = [
  { key: 'plateaus', name: 'Plateaus', standard: 1 },
  { key: 'buildings', name: 'Buildings', standard: 1 },
  { key: 'water', name: 'Water', standard: 1 },
  { key: 'lava', name: 'Lava', standard: 1 },
  { key: 'pads', name: 'Jump pads', standard: 1 },
  { key: 'zipLines', name: 'Zip lines', standard: 1 },
  { key: 'ravines', name: 'Ravines', standard: 0 },
  { key: 'caves', name: 'Caves', standard: 0 },
  { key: 'teleporters', name: 'Teleporters', standard: 0 },
  { key: 'jetpacks', name: 'Jetpacks', standard: 0 },
] as const

export type FeatureName = (typeof FEATURES)[number]['key']

export type FeatureAmounts = Record<FeatureName, number>

export const STANDARD_FEATURES = Object.fromEntries(
  FEATURES.map(({ key, standard }) => [key, standard]),
) as FeatureAmounts

// Movers that a generated map may have.

export const MOVERS = [
  { key: 'doors', name: 'Doors' },
  { key: 'lifts', name: 'Lifts' },
  { key: 'platforms', name: 'Platforms' },
  { key: 'floors', name: 'Floors that vanish' },
  { key: 'conveyors', name: 'Conveyors' },
  { key: 'crates', name: 'Crates' },
] as const

export type MoverName = (typeof MOVERS)[number]['key']

export const NO_MOVERS = Object.fromEntries(MOVERS.map(({ key }) => [key, 0])) as Record<MoverName, number>

export function randomSeed(): number {
  return Math.floor(Math.random() * 1e6)
}
