// Controls that all panels are made of.

import type { ComponentChildren } from 'preact'
import { useId, useState } from 'preact/hooks'
import { abilityName } from '../data/abilities'
import { percent } from '../data/format'
import type { Ability } from '../gen/surefoot/world/v1/map_pb'
import { lookOf } from '../view/abilities'
import { chanceColour, formatColour, type Rgb } from '../view/colours'
import { Icon, type IconName } from './icons'

interface ButtonProps {
  label: string
  onClick: () => void
  icon?: IconName | undefined
  /** Shows the icon alone; the label is its accessible name. */
  bare?: boolean
  tone?: 'main' | 'bad' | 'plain'
  disabled?: boolean
  /** For buttons that stay down. */
  pressed?: boolean
  hint?: string | undefined
}

export function Button({ label, onClick, icon, bare, tone = 'plain', disabled, pressed, hint }: ButtonProps) {
  return (
    <button
      type="button"
      class={`button ${tone} ${bare ? 'bare' : ''}`}
      aria-label={bare ? label : undefined}
      aria-pressed={pressed}
      title={hint ?? (bare ? label : undefined)}
      disabled={disabled}
      onClick={onClick}
    >
      {icon && <Icon name={icon} size={16} />}
      {!bare && <span>{label}</span>}
    </button>
  )
}

/** Asks once more, in its own place, before it does what cannot be taken back. */
export function SureButton(props: {
  label: string
  question: string
  onSure: () => void
  icon?: IconName
  bare?: boolean
}) {
  const [asking, setAsking] = useState(false)
  if (!asking) {
    const { label, icon, bare = false } = props
    return <Button label={label} icon={icon} bare={bare} tone="bad" onClick={() => setAsking(true)} />
  }
  return (
    <span class="sure" role="group" aria-label={props.question}>
      <span>{props.question}</span>
      <Button
        label="Yes"
        tone="bad"
        onClick={() => {
          setAsking(false)
          props.onSure()
        }}
      />
      <Button label="No" onClick={() => setAsking(false)} />
    </span>
  )
}

export function Section(props: { title: string; children: ComponentChildren; actions?: ComponentChildren }) {
  const id = useId()
  return (
    <section class="section" aria-labelledby={id}>
      <header>
        <h2 id={id}>{props.title}</h2>
        {props.actions}
      </header>
      {props.children}
    </section>
  )
}

export function Empty({ title, children }: { title: string; children?: ComponentChildren }) {
  return (
    <div class="empty">
      <strong>{title}</strong>
      {children}
    </div>
  )
}

interface SliderProps {
  label: string
  value: number
  min: number
  max: number
  step: number
  onInput: (value: number) => void
  onChange?: (value: number) => void
  shown?: string
  disabled?: boolean
}

export function Slider({ label, value, min, max, step, onInput, onChange, shown, disabled }: SliderProps) {
  const id = useId()
  return (
    <div class="slider">
      <label for={id}>{label}</label>
      <output for={id}>{shown ?? value}</output>
      <input
        id={id}
        type="range"
        value={value}
        min={min}
        max={max}
        step={step}
        disabled={disabled}
        aria-valuetext={shown}
        onInput={(event) => onInput(event.currentTarget.valueAsNumber)}
        onChange={(event) => onChange?.(event.currentTarget.valueAsNumber)}
      />
    </div>
  )
}

interface NumberProps {
  label: string
  value: number
  min: number
  max: number
  step?: number
  onChange: (value: number) => void
}

/** A number; what is out of range is brought into it once the field is left. */
export function NumberField({ label, value, min, max, step = 1, onChange }: NumberProps) {
  const id = useId()
  return (
    <div class="field">
      <label for={id}>{label}</label>
      <input
        id={id}
        type="number"
        inputMode="decimal"
        value={value}
        min={min}
        max={max}
        step={step}
        onInput={(event) => {
          const given = event.currentTarget.valueAsNumber
          if (given >= min && given <= max) onChange(given)
        }}
        onChange={(event) => {
          const given = event.currentTarget.valueAsNumber
          const kept = Number.isFinite(given) ? Math.min(max, Math.max(min, given)) : value
          event.currentTarget.value = String(kept)
          onChange(kept)
        }}
      />
    </div>
  )
}

interface SelectProps<T extends string> {
  label: string
  value: T
  options: readonly { value: T; name: string }[]
  onChange: (value: T) => void
}

export function SelectField<T extends string>({ label, value, options, onChange }: SelectProps<T>) {
  const id = useId()
  return (
    <div class="field">
      <label for={id}>{label}</label>
      <select
        id={id}
        value={value}
        onChange={(event) => {
          const chosen = options.find((option) => option.value === event.currentTarget.value)
          if (chosen !== undefined) onChange(chosen.value)
        }}
      >
        {options.map((option) => (
          <option key={option.value} value={option.value}>
            {option.name}
          </option>
        ))}
      </select>
    </div>
  )
}

export function Check(props: { label: string; checked: boolean; onChange: (checked: boolean) => void }) {
  return (
    <label class="check">
      <input
        type="checkbox"
        checked={props.checked}
        onChange={(event) => props.onChange(event.currentTarget.checked)}
      />
      <span>{props.label}</span>
    </label>
  )
}

/** One of a few, side by side. */
export function Choice<T extends string>({ label, value, options, onChange }: SelectProps<T>) {
  return (
    <div class="choice" role="radiogroup" aria-label={label}>
      {options.map((option) => (
        <label key={option.value} class={option.value === value ? 'chosen' : ''}>
          <input type="radio" name={label} checked={option.value === value} onChange={() => onChange(option.value)} />
          {option.name}
        </label>
      ))}
    </div>
  )
}

export function AbilityDot({ ability }: { ability: Ability }) {
  return <i class="dot" style={{ background: lookOf(ability).colour }} />
}

export function AbilityName({ ability }: { ability: Ability }) {
  return (
    <span class="ability">
      <AbilityDot ability={ability} />
      {abilityName(ability)}
    </span>
  )
}

/** A chance as a bar with its number. */
export function ChanceBar({ chance, label = 'Chance of success' }: { chance: number; label?: string }) {
  const style = { width: `${Math.max(2, chance * 100)}%`, background: formatColour(chanceColour(chance)) }
  return (
    <span class="chance" role="img" aria-label={`${label}: ${percent(chance)}`} title={`${label}: ${percent(chance)}`}>
      <span class="chance-bar">
        <span style={style} />
      </span>
      <span class="number">{percent(chance)}</span>
    </span>
  )
}

const STOPS = [0, 0.25, 0.5, 0.75, 1]

/** A legend of colours that run from one value to another. `colour`: that of a share of the way. */
export function Ramp({ colour, low, high }: { colour: (share: number) => Rgb; low: string; high: string }) {
  const stops = STOPS.map((share) => formatColour(colour(share))).join(', ')
  return (
    <p class="legend-ramp">
      <span>{low}</span>
      <span class="ramp" style={{ background: `linear-gradient(90deg, ${stops})` }} />
      <span>{high}</span>
    </p>
  )
}

/** Names and values, two by two. */
export function Facts({ rows }: { rows: readonly (readonly [name: string, value: ComponentChildren])[] }) {
  return (
    <dl class="facts">
      {rows.map(([name, value]) => (
        <div key={name}>
          <dt>{name}</dt>
          <dd>{value}</dd>
        </div>
      ))}
    </dl>
  )
}

export function Progress({ label, share }: { label: string; share: number | undefined }) {
  return (
    <progress class="progress" aria-label={label} max={1} {...(share === undefined ? {} : { value: share })}>
      {label}
    </progress>
  )
}
