import type { Studio } from '../data/studio'
import { recording, savePicture, toggleClip } from './capture'
import { Button, Slider } from './controls'

/** How the map is looked at. */
export function ViewBar({ studio }: { studio: Studio }) {
  const { view, graphs, level } = studio
  const height = level.features.value?.size.height ?? 80
  const isBright = graphs.filter.value.presence === 'full'
  const isRecording = recording.value !== undefined
  return (
    <div class="view-bar">
      <div class="group" role="toolbar" aria-label="View">
        <Button
          label="Top view"
          icon="top"
          bare
          hint="Top view (T)"
          pressed={view.top.value}
          onClick={() => (view.top.value = !view.top.value)}
        />
        <Button
          label="Show the whole map"
          icon="frame"
          bare
          hint="Show the whole map (H)"
          onClick={() => studio.viewport.value?.frameMap()}
        />
        <Button
          label="Graph"
          icon="graph"
          bare
          hint="Bring out the edges of the graph (G)"
          pressed={isBright}
          onClick={() => studio.toggleGraph()}
        />
        <Button
          label="Names"
          icon="names"
          bare
          hint="Names of places (N)"
          pressed={view.names.value}
          onClick={() => view.setNames(!view.names.value)}
        />
        <Button
          label="Trails"
          icon="trails"
          bare
          hint="Trails (L)"
          pressed={view.trails.value}
          onClick={() => (view.trails.value = !view.trails.value)}
        />
        <Button
          label="Section"
          icon="section"
          bare
          hint="Look into houses and caves"
          pressed={view.section.value}
          onClick={() => (view.section.value = !view.section.value)}
        />
        <i class="divider" />
        <Button label="Save a picture" icon="picture" bare onClick={() => void savePicture(studio)} />
        <Button
          label={isRecording ? 'Stop and save the clip' : 'Record a clip'}
          icon={isRecording ? 'stop' : 'record'}
          bare
          tone={isRecording ? 'bad' : 'plain'}
          onClick={() => void toggleClip(studio)}
        />
      </div>
      {view.section.value && (
        <div class="section-slider">
          <Slider
            label="Hide above"
            min={0}
            max={height}
            step={0.5}
            value={view.sectionHeight.value}
            shown={`${view.sectionHeight.value} m`}
            onInput={(value) => (view.sectionHeight.value = value)}
          />
        </div>
      )}
    </div>
  )
}
