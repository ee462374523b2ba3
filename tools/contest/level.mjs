// Reads what a NavMesh needs from the binary glTF files of `surefoot map export`.

/** What is on the ground of a level: names of nodes begin with these words. */
const LAVA = /^lava_/
const WATER = /^water_/
const DEVICE = /^(pad_|jetpack_|zip_line_\d+:from|teleporter_\d+:(from|to))/

/** Splits a binary glTF file into its document and its buffer. */
function open(file) {
  const jsonLength = file.readUInt32LE(12)
  return { gltf: JSON.parse(file.subarray(20, 20 + jsonLength).toString('utf8')), binary: file.subarray(20 + jsonLength + 8) }
}

/** Positions and indices of the mesh `ground`: the solid triangles of a map. */
export function ground(file) {
  const { gltf, binary } = open(file)
  const [primitive] = gltf.meshes[gltf.nodes.find(({ name }) => name === 'ground').mesh].primitives
  const read = (at, Type, width) => {
    const accessor = gltf.accessors[at]
    const view = gltf.bufferViews[accessor.bufferView]
    const begin = binary.byteOffset + (view.byteOffset ?? 0) + (accessor.byteOffset ?? 0)
    // A copy: the offset need not be a multiple of four.
    return new Type(binary.buffer.slice(begin, begin + accessor.count * width * 4))
  }
  return {
    positions: read(primitive.attributes.POSITION, Float32Array, 3),
    indices: read(primitive.indices, Uint32Array, 1),
  }
}

/**
 * Places that an agent should stay out of, or would rather go round: upright boxes or cylinders, each with a `kind`.
 * A level designer marks them by volumes.
 */
export function volumes(file) {
  const { gltf } = open(file)
  const kinds = [
    ['lava', LAVA, poolVolume],
    ['water', WATER, poolVolume],
    ['device', DEVICE, discVolume],
  ]
  return gltf.nodes.flatMap((node) => {
    const found = kinds.find(([, names]) => names.test(node.name))
    // An empty node marks where a device leads to: nothing happens to those who walk there.
    return found === undefined || node.mesh === undefined ? [] : [{ kind: found[0], ...found[2](node, gltf) }]
  })
}

/** A pool reaches from its surface, at the node's origin, down to its depth. */
function poolVolume({ translation: [x, y, z], scale: [width, depth, length], extras }) {
  const [low, high] = [y - depth, y]
  if (extras?.outline === 'round') return { low, high, centre: [x, z], radius: extras.radius }
  return { low, high, centre: [x, z], half: [width / 2, length / 2] }
}

/** A device is a disc on the ground. */
function discVolume({ translation: [x, y, z], mesh }, gltf) {
  const corners = gltf.accessors[gltf.meshes[mesh].primitives[0].attributes.POSITION]
  return { low: y + corners.min[1], high: y + corners.max[1], centre: [x, z], radius: corners.max[0] }
}
