import type { Studio } from '../data/studio'
import { Banner } from './banner'
import { Dashboard } from './dashboard'
import { Panel } from './panel'
import { Rail } from './rail'
import { Shortcuts } from './shortcuts'
import { Stage } from './stage'
import { ToastList } from './toast-list'
import { TokenPrompt } from './token-prompt'
import { TopBar } from './top-bar'
import { TourCard } from './tour-card'

export function App({ studio }: { studio: Studio }) {
  return (
    <div class={`app ${studio.panelOpen.value ? 'with-panel' : ''}`}>
      <TopBar studio={studio} />
      <Rail studio={studio} />
      <main class="middle">
        <Banner studio={studio} />
        <Stage studio={studio} />
      </main>
      <Panel studio={studio} />
      <Dashboard studio={studio} />
      <TourCard studio={studio} />
      <ToastList toasts={studio.context.toasts} />
      <Shortcuts studio={studio} />
      <TokenPrompt context={studio.context} />
    </div>
  )
}
