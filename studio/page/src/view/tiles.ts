// Which tiles are there, at what detail, and which have to give way. No renderer here.

/** What is kept for one tile at one detail. */
export interface KeptTile {
  triangles: number
  /** Middle of the tile seen from above, m. */
  middle: { x: number; z: number }
}

interface Slot<T> {
  coarse?: T
  fine?: T
}

/** Coarse and fine tiles by place; the fine one is shown where there is one. */
export class TileStore<T extends KeptTile> {
  private readonly slots = new Map<string, Slot<T>>()

  /** Keeps a tile and returns the one that it replaces. */
  put(key: string, tile: T, fine: boolean): T | undefined {
    const slot = this.slots.get(key) ?? {}
    this.slots.set(key, slot)
    const old = fine ? slot.fine : slot.coarse
    slot[fine ? 'fine' : 'coarse'] = tile
    return old
  }

  /** Forgets a place, and returns what was kept for it. */
  remove(key: string): T[] {
    const { coarse, fine } = this.slots.get(key) ?? {}
    this.slots.delete(key)
    return [coarse, fine].filter((tile) => tile !== undefined)
  }

  shown(key: string): T | undefined {
    const slot = this.slots.get(key)
    return slot?.fine ?? slot?.coarse
  }

  *allShown(): Generator<[string, T]> {
    for (const [key, slot] of this.slots) {
      const tile = slot.fine ?? slot.coarse
      if (tile) {
        yield [key, tile]
      }
    }
  }

  *all(): Generator<T> {
    for (const slot of this.slots.values()) {
      if (slot.coarse) {
        yield slot.coarse
      }
      if (slot.fine) {
        yield slot.fine
      }
    }
  }

  fineKeys(): Set<string> {
    return new Set([...this.slots].filter(([, slot]) => slot.fine).map(([key]) => key))
  }

  /** Drops the farthest fine tiles until their triangles keep to `budget`; those without a coarse one stay. */
  evict(around: { x: number; z: number }, budget: number): { key: string; tile: T }[] {
    const fine = [...this.slots].flatMap(([key, slot]) => (slot.fine ? [{ key, slot, tile: slot.fine }] : []))
    let triangles = fine.reduce((sum, { tile }) => sum + tile.triangles, 0)
    const distance = ({ tile }: { tile: T }): number => Math.hypot(tile.middle.x - around.x, tile.middle.z - around.z)
    const dropped: { key: string; tile: T }[] = []
    for (const { key, slot, tile } of fine
      .filter(({ slot }) => slot.coarse)
      .sort((a, b) => distance(b) - distance(a))) {
      if (triangles <= budget) {
        break
      }
      delete slot.fine
      triangles -= tile.triangles
      dropped.push({ key, tile })
    }
    return dropped
  }

  clear(): void {
    this.slots.clear()
  }
}
