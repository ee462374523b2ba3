const MAX_BYTES = 64

/** Why a layer cannot be called so; undefined: it can. */
export function layerNameFault(name: string): string | undefined {
  const trimmed = name.trim()
  if (trimmed === '') return 'A layer needs a name.'
  if (new TextEncoder().encode(trimmed).length > MAX_BYTES) return `A name can have at most ${MAX_BYTES} bytes.`
  return /[\u0000-\u001f\u007f-\u009f]/.test(trimmed) ? 'A name cannot have control characters.' : undefined
}
