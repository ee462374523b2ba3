import type { Toasts } from '../data/toasts'
import { Button } from './controls'

export function ToastList({ toasts }: { toasts: Toasts }) {
  return (
    <div class="toasts" role="status" aria-live="polite" aria-label="Messages">
      {toasts.shown.value.map(({ id, text, tone }) => (
        <div class={`toast ${tone}`} key={id}>
          <span>{text}</span>
          <Button label="Dismiss" icon="close" bare onClick={() => toasts.dismiss(id)} />
        </div>
      ))}
    </div>
  )
}
