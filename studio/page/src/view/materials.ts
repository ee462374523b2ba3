// Materials of the scene and the values that they share: light, fog, section, size of the picture.

import {
  type DataTexture,
  DoubleSide,
  FrontSide,
  GreaterDepth,
  LessEqualDepth,
  ShaderMaterial,
  Vector2,
  Vector3,
} from 'three'
import { parseColour, type Rgb, STATE_COLOURS } from './colours'
import {
  ARROW_VERTEX,
  LAID_VERTEX,
  LINE_FRAGMENT,
  LINE_VERTEX,
  NPC_FRAGMENT,
  NPC_VERTEX,
  PLAIN_FRAGMENT,
  SOLID_FRAGMENT,
  SOLID_VERTEX,
  SPRITE_FRAGMENT,
  SPRITE_VERTEX,
  TERRAIN_FRAGMENT,
  TERRAIN_VERTEX,
  TRAIL_VERTEX,
} from './shaders'
import { type Palette, SUN } from './theme'

const NO_SECTION = 1e9

/** Numbers of states in the shader. */
export const STATES = ['idle', 'seeking', 'down'] as const

const vector = (): { value: Vector3 } => ({ value: new Vector3() })

export interface Overlay {
  /** What is in sight. */
  plain: ShaderMaterial
  /** What something hides, faintly; undefined: it is not drawn. */
  behind?: ShaderMaterial
}

/** All materials of a view; they share their values and are changed together. */
export class Materials {
  readonly uniforms = {
    uSection: { value: NO_SECTION },
    uFogColour: vector(),
    uFogRange: { value: new Vector2(1e6, 2e6) },
    uSkyLight: vector(),
    uBounceLight: vector(),
    uSunLight: vector(),
    uSun: { value: new Vector3(...SUN) },
    uLow: vector(),
    uHigh: vector(),
    uCliff: vector(),
    uCeiling: vector(),
    uRoof: vector(),
    uWall: vector(),
    uCut: vector(),
    uOutline: vector(),
    uHeights: { value: new Vector2(0, 1) },
    uHalf: { value: new Vector2(1, 1) },
    uRatio: { value: 1 },
    uNear: { value: 0.1 },
    uScale: { value: 1 },
    uThin: { value: 1 },
    uSoftRange: { value: new Vector2(1, 2) },
    uNow: { value: 0 },
    uLasting: { value: 5 },
    uPoses: { value: null as DataTexture | null },
    uStates: { value: STATES.map((state) => new Vector3(...parseColour(STATE_COLOURS[state]))) },
  }

  private readonly all: ShaderMaterial[] = []
  readonly terrain = this.make(TERRAIN_VERTEX, TERRAIN_FRAGMENT)
  readonly solid = this.make(SOLID_VERTEX, SOLID_FRAGMENT)
  readonly glowing = this.make(SOLID_VERTEX, SOLID_FRAGMENT, { glow: 0.85 })
  readonly glass = this.make(SOLID_VERTEX, SOLID_FRAGMENT, {
    glow: 0.35,
    opacity: 0.62,
    blended: true,
    bothSides: true,
  })
  readonly npcs = this.make(NPC_VERTEX, NPC_FRAGMENT)
  readonly hiddenNpcs = this.make(NPC_VERTEX, NPC_FRAGMENT, { glow: 0.6, opacity: 0.3, blended: true, behind: true })
  readonly bedrock = this.make(SOLID_VERTEX, SOLID_FRAGMENT, { glow: 1 })
  readonly lines = this.overlay(LINE_VERTEX, LINE_FRAGMENT, 0.16)
  readonly dashes = this.overlay(LINE_VERTEX, LINE_FRAGMENT, 0.16, { DASHED: '' })
  /** Lines without outlines that fade with the distance. */
  readonly softLines: Overlay = {
    plain: this.make(LINE_VERTEX, LINE_FRAGMENT, { blended: true, bothSides: true, defines: { SOFT: '' } }),
  }
  readonly sprites = this.overlay(SPRITE_VERTEX, SPRITE_FRAGMENT, 0.2)
  readonly arrows = this.overlay(ARROW_VERTEX, PLAIN_FRAGMENT, 0.16)
  /** Areas on the ground, which shines through. */
  readonly areas = {
    plain: this.make(LAID_VERTEX, PLAIN_FRAGMENT, { opacity: 0.6, blended: true, bothSides: true }),
    behind: this.make(LAID_VERTEX, PLAIN_FRAGMENT, { opacity: 0.14, blended: true, bothSides: true, behind: true }),
  }
  readonly trails = this.make(TRAIL_VERTEX, PLAIN_FRAGMENT, { blended: true })

  setPalette(palette: Palette): void {
    const set = (uniform: { value: Vector3 }, colour: Rgb): void => void uniform.value.set(...colour)
    const { uniforms } = this
    set(uniforms.uFogColour, palette.background)
    set(uniforms.uSkyLight, palette.skyLight)
    set(uniforms.uBounceLight, palette.bounceLight)
    set(uniforms.uSunLight, palette.sunLight)
    set(uniforms.uLow, palette.low)
    set(uniforms.uHigh, palette.high)
    set(uniforms.uCliff, palette.cliff)
    set(uniforms.uCeiling, palette.ceiling)
    set(uniforms.uRoof, palette.roof)
    set(uniforms.uWall, palette.wall)
    set(uniforms.uCut, palette.cut)
    set(uniforms.uOutline, palette.outline)
  }

  /** Cutting costs time for every pixel, so the shaders include it only while there is a section. */
  setSection(height: number | undefined): void {
    this.uniforms.uSection.value = height ?? NO_SECTION
    const cut = height !== undefined
    if (cut === 'SECTION' in this.terrain.defines) {
      return
    }
    this.terrain.side = cut ? DoubleSide : FrontSide
    for (const material of this.all) {
      if (cut) {
        material.defines['SECTION'] = ''
      } else {
        delete material.defines['SECTION']
      }
      material.needsUpdate = true
    }
  }

  dispose(): void {
    this.all.forEach((material) => material.dispose())
  }

  private make(
    vertexShader: string,
    fragmentShader: string,
    look: {
      glow?: number
      opacity?: number
      blended?: boolean
      behind?: boolean
      bothSides?: boolean
      defines?: object
    } = {},
  ): ShaderMaterial {
    const material = new ShaderMaterial({
      vertexShader,
      fragmentShader,
      uniforms: { ...this.uniforms, uGlow: { value: look.glow ?? 0 }, uOpacity: { value: look.opacity ?? 1 } },
      defines: { ...look.defines },
      transparent: look.blended ?? false,
      depthWrite: !look.blended,
      depthFunc: look.behind ? GreaterDepth : LessEqualDepth,
      side: look.bothSides ? DoubleSide : FrontSide,
    })
    this.all.push(material)
    return material
  }

  private overlay(vertexShader: string, fragmentShader: string, faint: number, defines: object = {}): Overlay {
    const look = { blended: true, bothSides: true, defines }
    return {
      plain: this.make(vertexShader, fragmentShader, look),
      behind: this.make(vertexShader, fragmentShader, { ...look, opacity: faint, behind: true }),
    }
  }
}
