import { render } from 'preact'
import type { Question } from '../data/net/consent'
import { Button } from './controls'
import { Dialog } from './dialog'

/** Asks in `root`, before anything else is shown there, whether a foreign origin may be contacted. */
export function askForConsent(root: HTMLElement, question: Question): Promise<boolean> {
  return new Promise((resolve) => {
    const answer = (isAgreed: boolean) => {
      render(null, root)
      resolve(isAgreed)
    }
    render(<ConsentPrompt question={question} onAnswer={answer} />, root)
  })
}

function ConsentPrompt({ question, onAnswer }: { question: Question; onAnswer: (isAgreed: boolean) => void }) {
  const { service, origin, otherwise } = question
  return (
    <Dialog title={`Connect to another ${service}?`} onClose={() => onAnswer(false)}>
      <p>This link names a {service} that does not belong to this page:</p>
      <code class="origin">{origin}</code>
      <p>
        Connect only if you know who runs it. Nothing has been sent there yet. Tokens of other addresses are never sent
        there; if it needs a token, you are asked for one afterwards.
      </p>
      <p>
        Otherwise this page uses <code class="origin">{otherwise}</code>
      </p>
      <div class="row end wrap">
        <Button label="Connect" onClick={() => onAnswer(true)} />
        <Button label="Do not connect" tone="main" onClick={() => onAnswer(false)} />
      </div>
    </Dialog>
  )
}
