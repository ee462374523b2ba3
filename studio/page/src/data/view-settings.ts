// How the map is looked at, and in which colours.

import { computed, signal } from '@preact/signals'

export type ThemeChoice = 'auto' | 'dark' | 'light'

const THEME_KEPT_AS = 'surefoot.theme'
const NAMES_KEPT_AS = 'surefoot.names'
const PLOTS_KEPT_AS = 'surefoot.plots'

export class ViewSettings {
  readonly top = signal(false)
  readonly trails = signal(true)
  /** Whether names of places are shown. */
  readonly names = signal(true)
  /** Whether the motion of a replay is plotted. */
  readonly plots = signal(false)
  /** Whether everything above `sectionHeight` is hidden. */
  readonly section = signal(false)
  readonly sectionHeight = signal(20)
  readonly theme = signal<ThemeChoice>('auto')
  private readonly systemIsDark = signal(false)
  readonly dark = computed(() => (this.theme.value === 'auto' ? this.systemIsDark.value : this.theme.value === 'dark'))

  constructor(private readonly store: Pick<Storage, 'getItem' | 'setItem'> | undefined) {
    this.theme.value = readTheme(store?.getItem(THEME_KEPT_AS))
    this.names.value = store?.getItem(NAMES_KEPT_AS) !== 'off'
    this.plots.value = store?.getItem(PLOTS_KEPT_AS) === 'on'
  }

  setTheme(theme: ThemeChoice): void {
    this.theme.value = theme
    this.store?.setItem(THEME_KEPT_AS, theme)
  }

  setNames(shown: boolean): void {
    this.names.value = shown
    this.store?.setItem(NAMES_KEPT_AS, shown ? 'on' : 'off')
  }

  setPlots(shown: boolean): void {
    this.plots.value = shown
    this.store?.setItem(PLOTS_KEPT_AS, shown ? 'on' : 'off')
  }

  /** Follows what the system prefers. */
  followSystem(query: MediaQueryList): void {
    this.systemIsDark.value = query.matches
    query.addEventListener('change', () => {
      this.systemIsDark.value = query.matches
    })
  }
}

function readTheme(text: string | null | undefined): ThemeChoice {
  return text === 'dark' || text === 'light' ? text : 'auto'
}
