import type { Studio } from '../data/studio'
import { Button, Slider } from './controls'

/** How the map is looked at. */
export function ViewBar({ studio }: { studio: Studio }) {
  const { view, graphs, level, npcs } = studio
  const height = level.features.value?.size.height ?? 80
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
          hint="Graph (G)"
          pressed={graphs.filter.value.visible}
          onClick={() => graphs.setFilter({ visible: !graphs.filter.value.visible })}
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
        <Button
          label="Follow the NPC"
          icon="follow"
          bare
          hint="Follow the selected NPC (F)"
          disabled={npcs.selectedId.value === undefined}
          pressed={npcs.camera.value}
          onClick={() => npcs.toggleCamera()}
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
