import type { MessageInitShape } from '@bufbuild/protobuf'
import { count, percent } from '../../data/format'
import type { Studio } from '../../data/studio'
import type { SurveyMapRequestSchema } from '../../gen/surefoot/world/v1/world_pb'
import { BODIES, type BodyName } from './kinds'

interface Props {
  studio: Studio
  /** Tells maps apart. */
  of: string
  map: Pick<MessageInitShape<typeof SurveyMapRequestSchema>, 'map' | 'mapHash' | 'pieces'>
  /** Whether the map is the one that is shown, so that places can be shown on it. */
  isShown: boolean
}

const ALL: readonly BodyName[] = BODIES.map(({ value }) => value)

/** Where bodies can stand and get to, by the map's geometry alone. */
export function SurveyTable({ studio: { surveys }, of, map, isShown }: Props) {
  const list = surveys.of.value === of ? surveys.list.value : []
  const ask = (bodies: readonly BodyName[]) => void surveys.run(of, map, bodies)
  const show = (body: string) => (surveys.shown.value = surveys.shown.value === body ? undefined : body)
  return (
    <div class="survey">
      <div class="row wrap">
        <button type="button" class="button" disabled={surveys.isRunning.value} onClick={() => ask(['surefoot'])}>
          {surveys.isRunning.value ? 'Surveying …' : 'Places to stand'}
        </button>
        <button type="button" class="button" disabled={surveys.isRunning.value} onClick={() => ask(ALL)}>
          Compare bodies
        </button>
      </div>
      {list.length > 0 && (
        <table aria-label="Reachability by body">
          <thead>
            <tr>
              <th scope="col">Body</th>
              <th scope="col" title="Places to stand, 1.25 m apart">
                Places
              </th>
              <th scope="col" title="Ground that is connected on foot">
                Islands
              </th>
              <th scope="col" title="Pairs of places that are connected by every means">
                Connected
              </th>
              <th
                scope="col"
                title="Places that no way leads to from the spawn points, or without any from the largest region"
              >
                Cut off
              </th>
            </tr>
          </thead>
          <tbody>
            {list.map(({ body, survey }) => (
              <tr key={body}>
                <th scope="row">{BODIES.find(({ value }) => value === body)?.name ?? body}</th>
                <td>{count(survey.places)}</td>
                <td>{count(survey.islands)}</td>
                <td>{percent(survey.connected)}</td>
                <td>
                  {isShown && survey.cutOffPlaces > 0 ? (
                    <button
                      type="button"
                      class="button bare"
                      aria-pressed={surveys.shown.value === body}
                      title="Show them on the map"
                      onClick={() => show(body)}
                    >
                      {count(survey.cutOffPlaces)}
                    </button>
                  ) : (
                    count(survey.cutOffPlaces)
                  )}
                </td>
              </tr>
            ))}
          </tbody>
        </table>
      )}
    </div>
  )
}
