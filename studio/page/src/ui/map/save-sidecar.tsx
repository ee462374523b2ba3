import type { Studio } from '../../data/studio'
import { giveFile } from '../capture'
import { Button } from '../controls'

/** Gives the browser the file that belongs beside the level's, once it lists something. */
export function SaveSidecar({ studio: { levels, marks } }: { studio: Studio }) {
  const imported = levels.imported.value
  if (imported?.frame === undefined || (levels.sidecar.value === '' && marks.list.value.length === 0)) return null
  const save = () => {
    const name = `${imported.name.replace(/\.[^.]*$/, '')}.surefoot.json`
    const content = levels.sidecarWith(marks.list.peek())
    if (content !== undefined) giveFile(name, new Blob([content], { type: 'application/json' }))
  }
  return <Button label="Save the sidecar" icon="check" onClick={save} />
}
