// Draws the two scenes into a canvas. Where there is no graphics card, what stands still is kept as a picture with its
// depths, so that a walking NPC does not cost the whole ground again.

import {
  AlwaysDepth,
  BufferAttribute,
  BufferGeometry,
  Color,
  DepthTexture,
  LinearSRGBColorSpace,
  LineSegments,
  Mesh,
  NearestFilter,
  PerspectiveCamera,
  Points,
  Scene,
  ShaderMaterial,
  UnsignedIntType,
  WebGLRenderer,
  WebGLRenderTarget,
} from 'three'
import type { Rgb } from './colours'

const MOST_RATIO = 1.5

/** Whether pictures are worked out by the processor. */
function drawsInSoftware(): boolean {
  const gl = document.createElement('canvas').getContext('webgl2')
  if (!gl) {
    throw new Error('The 3D view needs WebGL 2, which this browser does not offer or has switched off.')
  }
  const info = gl.getExtension('WEBGL_debug_renderer_info')
  const name = String(gl.getParameter(info ? info.UNMASKED_RENDERER_WEBGL : gl.RENDERER))
  gl.getExtension('WEBGL_lose_context')?.loseContext()
  return /swiftshader|llvmpipe|softpipe|software|basic render/i.test(name)
}

/** The picture of what stands still, and how to put it back. */
class KeptPicture {
  private target: WebGLRenderTarget | undefined
  private readonly scene = new Scene()
  private readonly quad: Mesh<BufferGeometry, ShaderMaterial>
  valid = false

  constructor() {
    const geometry = new BufferGeometry()
    geometry.setAttribute('position', new BufferAttribute(new Float32Array([-1, -1, 0, 3, -1, 0, -1, 3, 0]), 3))
    const material = new ShaderMaterial({
      uniforms: { uColour: { value: null }, uDepth: { value: null } },
      vertexShader: 'void main() { gl_Position = vec4(position.xy, 0.0, 1.0); }',
      fragmentShader: /* glsl */ `
        uniform sampler2D uColour;
        uniform sampler2D uDepth;
        void main() {
          ivec2 at = ivec2(gl_FragCoord.xy);
          gl_FragColor = texelFetch(uColour, at, 0);
          gl_FragDepth = texelFetch(uDepth, at, 0).r;
        }
      `,
      depthTest: true,
      depthFunc: AlwaysDepth,
    })
    this.quad = new Mesh(geometry, material)
    this.quad.frustumCulled = false
    this.scene.add(this.quad)
  }

  fill(renderer: WebGLRenderer, width: number, height: number, draw: () => void): void {
    if (this.target?.width !== width || this.target.height !== height) {
      this.release()
      const depthTexture = new DepthTexture(width, height, UnsignedIntType)
      this.target = new WebGLRenderTarget(width, height, {
        depthTexture,
        minFilter: NearestFilter,
        magFilter: NearestFilter,
      })
      this.quad.material.uniforms['uColour']!.value = this.target.texture
      this.quad.material.uniforms['uDepth']!.value = depthTexture
    }
    renderer.setRenderTarget(this.target)
    draw()
    renderer.setRenderTarget(null)
    this.valid = true
  }

  show(renderer: WebGLRenderer, camera: PerspectiveCamera): void {
    renderer.render(this.scene, camera)
  }

  release(): void {
    this.target?.depthTexture?.dispose()
    this.target?.dispose()
    this.target = undefined
    this.valid = false
  }

  dispose(): void {
    this.release()
    this.quad.geometry.dispose()
    this.quad.material.dispose()
  }
}

export class Stage {
  /** What moves only by hand. */
  readonly still = new Scene()
  /** What moves by itself. */
  readonly moving = new Scene()
  readonly camera = new PerspectiveCamera(50, 1, 0.1, 1000)
  readonly canvas = document.createElement('canvas')
  readonly software = drawsInSoftware()
  private readonly renderer: WebGLRenderer
  private readonly kept = new KeptPicture()
  private width = 1
  private height = 1
  private share = 1
  private readonly background = new Color()

  constructor(container: HTMLElement) {
    this.canvas.style.cssText = 'display:block;width:100%;height:100%;touch-action:none;outline-offset:-2px'
    this.renderer = new WebGLRenderer({
      canvas: this.canvas,
      antialias: !this.software,
      alpha: false,
      stencil: false,
      powerPreference: 'high-performance',
    })
    this.renderer.outputColorSpace = LinearSRGBColorSpace
    this.renderer.autoClear = false
    this.canvas.addEventListener('webglcontextlost', () => this.forget())
    this.canvas.addEventListener('webglcontextrestored', () => this.renderer.setClearColor(this.background, 1))
    container.append(this.canvas)
  }

  get size(): { width: number; height: number } {
    return { width: this.width, height: this.height }
  }

  /** Pixels of the picture per pixel of the page. */
  get ratio(): number {
    return this.fullRatio * this.share
  }

  /** The same where the picture is as sharp as it can be. */
  get fullRatio(): number {
    return Math.min(window.devicePixelRatio || 1, MOST_RATIO)
  }

  setBackground(colour: Rgb): void {
    this.background.setRGB(...colour)
    this.renderer.setClearColor(this.background, 1)
  }

  resize(width: number, height: number): void {
    this.width = Math.max(1, Math.round(width))
    this.height = Math.max(1, Math.round(height))
    this.apply()
  }

  /** Draws only this share of the full resolution; tells whether that is new. */
  setShare(share: number): boolean {
    const changed = share !== this.share
    if (changed) {
      this.share = share
      this.apply()
    }
    return changed
  }

  /** Forgets the kept picture: something in the still scene or the camera has changed. */
  invalidate(): void {
    this.kept.valid = false
  }

  /** `steady`: what stands still is as in the picture before, and may be kept. */
  draw(steady: boolean): void {
    const { renderer, camera } = this
    if (!this.software || !steady) {
      renderer.clear()
      renderer.render(this.still, camera)
      renderer.render(this.moving, camera)
      return
    }
    if (!this.kept.valid) {
      this.kept.fill(renderer, this.canvas.width, this.canvas.height, () => {
        renderer.clear()
        renderer.render(this.still, camera)
      })
    }
    renderer.clearDepth()
    this.kept.show(renderer, camera)
    renderer.render(this.moving, camera)
  }

  /** The picture's pixels, from the upper left, four bytes each. */
  read(): { width: number; height: number; pixels: Uint8Array } {
    const gl = this.renderer.getContext()
    const { width, height } = this.canvas
    const flipped = new Uint8Array(width * height * 4)
    gl.readPixels(0, 0, width, height, gl.RGBA, gl.UNSIGNED_BYTE, flipped)
    const pixels = new Uint8Array(flipped.length)
    for (let row = 0; row < height; row += 1) {
      pixels.set(flipped.subarray((height - 1 - row) * width * 4, (height - row) * width * 4), row * width * 4)
    }
    return { width, height, pixels }
  }

  dispose(): void {
    this.kept.dispose()
    this.renderer.dispose()
    this.renderer.forceContextLoss()
    this.canvas.remove()
  }

  /** What was on the graphics card is gone; it goes there again with the next picture. */
  private forget(): void {
    this.kept.release()
    for (const scene of [this.still, this.moving]) {
      scene.traverse((it) => {
        if (it instanceof Mesh || it instanceof Points || it instanceof LineSegments) {
          it.geometry.dispose()
          it.material.dispose()
        }
      })
    }
  }

  private apply(): void {
    this.renderer.setPixelRatio(this.ratio)
    this.renderer.setSize(this.width, this.height, false)
    this.camera.aspect = this.width / this.height
    this.kept.release()
  }
}
