// Reachability by body on a map, by its geometry.

import { signal } from '@preact/signals'
import type { MessageInitShape } from '@bufbuild/protobuf'
import type { Survey, SurveyMapRequestSchema } from '../../gen/surefoot/world/v1/world_pb'
import { type Context, report } from '../context'

/** Most places that are shown as cut off. */
const MAX_CUT_OFF = 2000

/** The survey of one body, by the name that it was asked for with. */
export interface Surveyed {
  body: string
  survey: Survey
}

export class Surveys {
  /** The map of the surveys: its own hash, or the hash of its world. */
  readonly of = signal('')
  readonly list = signal<readonly Surveyed[]>([])
  readonly isRunning = signal(false)
  /** Whose cut-off places are shown on the map. */
  readonly shown = signal<string | undefined>(undefined)
  private running: AbortController | undefined

  constructor(private readonly context: Context) {}

  /** Surveys a map for bodies; the results stay until another map is surveyed. */
  async run(
    key: string,
    map: Pick<MessageInitShape<typeof SurveyMapRequestSchema>, 'map' | 'mapHash' | 'pieces'>,
    bodies: readonly string[],
  ): Promise<void> {
    this.forget()
    const { signal } = (this.running = new AbortController())
    this.isRunning.value = true
    try {
      const request = { ...map, bodies: bodies.map((preset) => ({ preset })), maxCutOff: MAX_CUT_OFF }
      const { surveys } = await this.context.world.calls.surveyMap(request, { signal })
      this.of.value = key
      this.list.value = surveys.map((survey, index) => ({ body: bodies[index] ?? '', survey }))
    } catch (error) {
      if (!signal.aborted) report(this.context, 'The map was not surveyed', error)
    } finally {
      if (!signal.aborted) this.isRunning.value = false
    }
  }

  forget(): void {
    this.running?.abort()
    this.of.value = ''
    this.list.value = []
    this.shown.value = undefined
    this.isRunning.value = false
  }
}
