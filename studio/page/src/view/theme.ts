// Light and material colours of the scene, by theme.

import { parseColour, type Rgb } from './colours'
import type { Theme } from './viewport.types'

export interface Palette {
  background: Rgb
  /** Ground that can be stood on, at the map's lowest and highest. */
  low: Rgb
  high: Rgb
  cliff: Rgb
  ceiling: Rgb
  roof: Rgb
  wall: Rgb
  /** Where the section plane cuts through rock. */
  cut: Rgb
  skyLight: Rgb
  bounceLight: Rgb
  sunLight: Rgb
  water: Rgb
  lava: Rgb
  metal: Rgb
  /** Around lines and dots, so that they stand out. */
  outline: Rgb
  vertex: Rgb
}

const DARK: Palette = {
  background: parseColour('#12161c'),
  low: parseColour('#5f7f5c'),
  high: parseColour('#a7a48d'),
  cliff: parseColour('#7d6a5d'),
  ceiling: parseColour('#4f4a4a'),
  roof: parseColour('#c3ab9e'),
  wall: parseColour('#a58c82'),
  cut: parseColour('#41384a'),
  skyLight: [0.66, 0.7, 0.78],
  bounceLight: [0.34, 0.3, 0.3],
  sunLight: [0.5, 0.46, 0.38],
  water: parseColour('#2f7fe0'),
  lava: parseColour('#ff6a1a'),
  metal: parseColour('#8b95a3'),
  outline: parseColour('#0b0e13'),
  vertex: parseColour('#f2f5f8'),
}

const LIGHT: Palette = {
  background: parseColour('#e9eef3'),
  low: parseColour('#86a878'),
  high: parseColour('#cfc9ae'),
  cliff: parseColour('#a18872'),
  ceiling: parseColour('#7c7470'),
  roof: parseColour('#e3cfc2'),
  wall: parseColour('#c6aa9c'),
  cut: parseColour('#7b7183'),
  skyLight: [0.74, 0.77, 0.83],
  bounceLight: [0.46, 0.42, 0.4],
  sunLight: [0.42, 0.39, 0.32],
  water: parseColour('#3f8ff0'),
  lava: parseColour('#ff6a1a'),
  metal: parseColour('#7d8794'),
  outline: parseColour('#1a1f27'),
  vertex: parseColour('#ffffff'),
}

export function paletteOf(theme: Theme): Palette {
  return theme.dark ? DARK : LIGHT
}

/** Towards the sun, of length 1. */
export const SUN: Rgb = [0.5217, 0.7626, 0.3822]
