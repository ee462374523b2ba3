import type { ComponentChildren } from 'preact'
import { useEffect, useState } from 'preact/hooks'
import type { Studio } from '../data/studio'
import { type Tour, TOUR_STEPS } from '../data/tour'
import { Button } from './controls'
import { Icon } from './icons'

/** How long a step that is done stays, so that its effect is seen, ms. */
const DONE_MS = 1600
/** How often the pointed-at control is looked for: panels open and change, ms. */
const FIND_MS = 200

/** The tour: its offer, its steps beside the map, and a ring around the control that a step is about. */
export function TourCard({ studio: { tour } }: { studio: Studio }) {
  const { at, step, isDone } = tour
  const done = isDone.value
  useEffect(() => {
    if (!done) return undefined
    const timer = setTimeout(() => tour.next(), DONE_MS)
    return () => clearTimeout(timer)
  }, [tour, done])
  if (tour.isOffered.value) return <Offer tour={tour} />
  if (at.value === undefined) return null
  if (step.value === undefined) return <Farewell tour={tour} />
  return (
    <>
      {!done && <Ring target={step.value.target} />}
      <Card
        label={`Tour, step ${at.value + 1} of ${TOUR_STEPS.length}`}
        title={step.value.title}
        corner={<Button label="End the tour" icon="close" bare onClick={() => tour.end()} />}
        actions={
          <>
            <Dots at={at.value} />
            <Button label="Back" disabled={at.value === 0} onClick={() => tour.back()} />
            <Button label={done ? 'Next' : 'Skip'} tone={done ? 'main' : 'plain'} onClick={() => tour.next()} />
          </>
        }
      >
        <p aria-live="polite">
          {done ? (
            <span class="tour-done">
              <Icon name="check" /> Done.
            </span>
          ) : (
            step.value.text
          )}
        </p>
      </Card>
    </>
  )
}

function Offer({ tour }: { tour: Tour }) {
  return (
    <Card
      label="Tour"
      title="New here?"
      actions={
        <>
          <Button label="Not now" onClick={() => tour.end()} />
          <Button label="Take the tour" tone="main" onClick={() => tour.start()} />
        </>
      }
    >
      <p>In two minutes: look around, ask for a plan, forbid a leg, and see NPCs take another route.</p>
    </Card>
  )
}

function Farewell({ tour }: { tour: Tour }) {
  return (
    <Card
      label="Tour, end"
      title="That is the idea"
      actions={<Button label="Close" tone="main" onClick={() => tour.end()} />}
    >
      <p>
        Every edit works like this: NPCs follow it at once, and Ctrl Z takes it back. Press <kbd>?</kbd> for all keys
        and for this tour.
      </p>
    </Card>
  )
}

interface CardProps {
  label: string
  title: string
  corner?: ComponentChildren
  actions: ComponentChildren
  children: ComponentChildren
}

/** A card beside the map, with what can be done below its text. */
function Card({ label, title, corner, actions, children }: CardProps) {
  return (
    <section class="tour-card" aria-label={label}>
      <header>
        <h2>{title}</h2>
        {corner}
      </header>
      {children}
      <footer>{actions}</footer>
    </section>
  )
}

function Dots({ at }: { at: number }) {
  return (
    <span class="tour-dots" aria-hidden="true">
      {TOUR_STEPS.map(({ name }, index) => (
        <i key={name} class={index === at ? 'now' : index < at ? 'past' : ''} />
      ))}
    </span>
  )
}

/** A ring around the first control that a selector finds. */
function Ring({ target }: { target: string }) {
  const [box, setBox] = useState<DOMRect | undefined>(undefined)
  useEffect(() => {
    const find = () => setBox(document.querySelector(target)?.getBoundingClientRect())
    find()
    const timer = setInterval(find, FIND_MS)
    return () => clearInterval(timer)
  }, [target])
  if (box === undefined || box.width === 0) return null
  const style = { left: `${box.left}px`, top: `${box.top}px`, width: `${box.width}px`, height: `${box.height}px` }
  return <div class="tour-ring" style={style} aria-hidden="true" />
}
