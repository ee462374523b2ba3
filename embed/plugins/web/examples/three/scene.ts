// What the example shows: boxes, the NPC, and the plan that it follows.

import * as THREE from 'three'
import type { AgentState, Body, CastRays, Locomotion, Plan, Vec3 } from '../../dist/index.js'
import { RAY_RANGE_M, Surface } from '../../dist/index.js'
import { Figure } from './figure.ts'
import type { Box } from './level.ts'

export class Scene {
  private readonly scene = new THREE.Scene()
  private readonly camera = new THREE.PerspectiveCamera(50, 1, 0.1, 200)
  private readonly renderer = new THREE.WebGLRenderer({ antialias: true })
  private readonly solids: THREE.Mesh[]
  private readonly npc: Figure
  private readonly route = new THREE.Line(new THREE.BufferGeometry(), new THREE.LineBasicMaterial({ color: 0xffcc33 }))

  constructor(boxes: readonly Box[], body: Body) {
    this.solids = boxes.map(meshOf)
    this.npc = new Figure(body)
    const sun = new THREE.DirectionalLight(0xffffff, 2)
    sun.position.set(10, 30, 15)
    this.scene.background = new THREE.Color(0x202830)
    this.scene.add(...this.solids, this.npc.group, this.route, sun, new THREE.HemisphereLight(0xbfd8ff, 0x404040, 1.5))
    this.camera.position.set(0, 34, 32)
    this.camera.lookAt(0, 0, 0)
    document.body.append(this.renderer.domElement)
    addEventListener('resize', () => this.resize())
    this.resize()
  }

  /** Calls `onPick` with the place of each click on the level. */
  onClick(onPick: (place: Vec3) => void): void {
    const raycaster = new THREE.Raycaster()
    this.renderer.domElement.addEventListener('click', ({ clientX, clientY }) => {
      const onScreen = new THREE.Vector2((2 * clientX) / innerWidth - 1, 1 - (2 * clientY) / innerHeight)
      raycaster.setFromCamera(onScreen, this.camera)
      const hit = raycaster.intersectObjects(this.solids)[0]
      // Characters stand on faces that look up, and nowhere else.
      if (hit?.face != null && hit.face.normal.y > 0.7) onPick(hit.point)
    })
  }

  /** Casts an agent's rays at the level with three.js. A game asks its physics engine. */
  castRays: CastRays = (origins, directions) => {
    const rayCount = origins.length / 3
    const hits = { distances: new Float32Array(rayCount), surfaces: new Uint8Array(rayCount) }
    const raycaster = new THREE.Raycaster()
    raycaster.far = RAY_RANGE_M
    for (let ray = 0; ray < rayCount; ray++) {
      raycaster.ray.origin.fromArray(origins, 3 * ray)
      raycaster.ray.direction.fromArray(directions, 3 * ray)
      const hit = raycaster.intersectObjects(this.solids)[0]
      if (hit === undefined) continue
      hits.distances[ray] = hit.distance
      hits.surfaces[ray] = Surface.ground
    }
    return hits
  }

  showPlan(feet: Vec3, plan: Plan | undefined, waypointIdx: number): void {
    const places = plan === undefined ? [] : [feet, ...plan.waypoints.slice(waypointIdx)]
    this.route.geometry.dispose()
    this.route.geometry = new THREE.BufferGeometry().setFromPoints(
      places.map(({ x, y, z }) => new THREE.Vector3(x, y + 0.2, z)),
    )
  }

  draw({ feet, yaw }: AgentState, locomotion: Locomotion): void {
    this.npc.group.position.set(feet.x, feet.y + locomotion.stepOffsetM, feet.z)
    this.npc.group.rotation.y = yaw
    this.npc.animate(locomotion)
    this.renderer.render(this.scene, this.camera)
  }

  private resize(): void {
    this.renderer.setSize(innerWidth, innerHeight)
    this.camera.aspect = innerWidth / innerHeight
    this.camera.updateProjectionMatrix()
  }
}

function meshOf({ low, high }: Box): THREE.Mesh {
  const [from, to] = [new THREE.Vector3(...low), new THREE.Vector3(...high)]
  const size = to.clone().sub(from)
  const mesh = new THREE.Mesh(
    new THREE.BoxGeometry(size.x, size.y, size.z),
    new THREE.MeshLambertMaterial({ color: size.y > 4 ? 0x8090a0 : 0x708060 }),
  )
  mesh.position.copy(from.add(to).multiplyScalar(0.5))
  mesh.updateMatrixWorld()
  return mesh
}
