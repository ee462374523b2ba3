// Vectors in metres: right-handed, y up, as in three.js and glTF.

/** A place, a velocity or a direction. Vectors of three.js and of the services' messages are such values. */
export interface Vec3 {
  x: number
  y: number
  z: number
}

export const ZERO: Vec3 = { x: 0, y: 0, z: 0 }

export function add(a: Vec3, b: Vec3): Vec3 {
  return { x: a.x + b.x, y: a.y + b.y, z: a.z + b.z }
}

export function subtract(a: Vec3, b: Vec3): Vec3 {
  return { x: a.x - b.x, y: a.y - b.y, z: a.z - b.z }
}

export function scale(a: Vec3, factor: number): Vec3 {
  return { x: a.x * factor, y: a.y * factor, z: a.z * factor }
}

export function lengthOf({ x, y, z }: Vec3): number {
  return Math.sqrt(x * x + y * y + z * z)
}

export function distance(a: Vec3, b: Vec3): number {
  return lengthOf(subtract(a, b))
}

/** Turns a vector of the map's frame into the frame of a body with this heading: x right, y up, z forward. */
export function toLocal({ x, y, z }: Vec3, yaw: number): Vec3 {
  const [sin, cos] = [Math.sin(yaw), Math.cos(yaw)]
  return { x: z * sin - x * cos, y, z: x * sin + z * cos }
}
