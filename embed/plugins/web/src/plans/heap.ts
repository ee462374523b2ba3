// A heap of vertices by their costs, the cheapest on top.

export class Heap {
  private readonly entries: [cost: number, vertex: number][] = []

  push(cost: number, vertex: number): void {
    const { entries } = this
    let at = entries.push([cost, vertex]) - 1
    while (at > 0) {
      const parent = (at - 1) >> 1
      if (!isBelow(entries[at]!, entries[parent]!)) break
      swap(entries, at, parent)
      at = parent
    }
  }

  pop(): [cost: number, vertex: number] | undefined {
    const { entries } = this
    const [top, last] = [entries[0], entries.pop()]
    if (last === undefined || entries.length === 0) return top
    entries[0] = last
    for (let at = 0; ;) {
      const [left, right] = [2 * at + 1, 2 * at + 2]
      let least = at
      if (left < entries.length && isBelow(entries[left]!, entries[least]!)) least = left
      if (right < entries.length && isBelow(entries[right]!, entries[least]!)) least = right
      if (least === at) return top
      swap(entries, at, least)
      at = least
    }
  }
}

/** Equal costs are ordered by vertex, so that equal queries have equal answers. */
function isBelow(a: [number, number], b: [number, number]): boolean {
  return a[0] < b[0] || (a[0] === b[0] && a[1] < b[1])
}

function swap<T>(list: T[], a: number, b: number): void {
  const kept = list[a]!
  list[a] = list[b]!
  list[b] = kept
}
