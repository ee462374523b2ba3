import assert from 'node:assert/strict'
import { test } from 'node:test'
import { ground, volumes } from '../level.mjs'
import { Triangles } from '../triangles.mjs'
import { boxes } from './levels.mjs'

/** A binary glTF file of a document and a buffer. */
function glb(document, buffer) {
  const text = Buffer.from(JSON.stringify(document))
  const json = Buffer.concat([text, Buffer.alloc((4 - (text.length % 4)) % 4, ' ')])
  const header = Buffer.alloc(20)
  header.writeUInt32LE(json.length, 12)
  return Buffer.concat([header, json, Buffer.alloc(8), buffer])
}

test('ground, pools and devices are read, where devices lead to is not', () => {
  const corners = Float32Array.of(0, 0, 0, 1, 0, 0, 0, 0, 1)
  const file = glb(
    {
      nodes: [
        { name: 'ground', mesh: 0 },
        { name: 'lava_0', mesh: 1, translation: [10, 2, 20], scale: [6, 1.5, 8] },
        { name: 'water_0', mesh: 1, translation: [0, 1, 0], scale: [4, 1, 4], extras: { outline: 'round', radius: 2 } },
        { name: 'pad_0', mesh: 2, translation: [5, 3, 5] },
        { name: 'zip_line_0:to', translation: [9, 9, 9] },
      ],
      meshes: [{ primitives: [{ attributes: { POSITION: 0 }, indices: 1 }] }, {}, { primitives: [{ attributes: { POSITION: 2 } }] }],
      accessors: [
        { bufferView: 0, count: 3 },
        { bufferView: 1, count: 3 },
        { min: [-1.25, 0, -1.25], max: [1.25, 0.12, 1.25] },
      ],
      bufferViews: [{ byteOffset: 0 }, { byteOffset: 36 }],
    },
    Buffer.concat([Buffer.from(corners.buffer), Buffer.from(Uint32Array.of(0, 1, 2).buffer)]),
  )
  assert.deepEqual(ground(file), { positions: corners, indices: Uint32Array.of(0, 1, 2) })
  assert.deepEqual(volumes(file), [
    { kind: 'lava', low: 0.5, high: 2, centre: [10, 20], half: [3, 4] },
    { kind: 'water', low: 0, high: 1, centre: [0, 0], radius: 2 },
    { kind: 'device', low: 3, high: 3.12, centre: [5, 5], radius: 1.25 },
  ])
})

test('rays meet the nearest triangle, and capsules touch what is within their radius', () => {
  const box = [
    [2, 0, 2],
    [4, 3, 4],
  ]
  const triangles = new Triangles(boxes(box))
  assert.equal(triangles.heightAt(3, 3, 9, 1), 3)
  assert.equal(triangles.heightAt(3, 3, 2, 1), undefined)
  assert.equal(triangles.heightAt(5, 3, 9, -9), undefined)
  const { at, level } = triangles.firstHit([0, 1, 2.5], [9, 1, 2.5])
  assert.ok(Math.abs(at[0] - 2) < 1e-9 && level === 0)
  for (const [x, low, expected] of [
    [1.8, 1, true],
    [1.6, 1, false],
    [4.2, 2, true],
    [4.4, 2, false],
    [3, 3.2, true],
    [3, 3.4, false],
  ]) {
    assert.equal(triangles.touch(x, 3, low, low + 1, 0.3), expected, `x ${x}, low ${low}`)
  }
})
