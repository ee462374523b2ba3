// What a failed call means to the page, and to the one who reads it.

import { Code, ConnectError } from '@connectrpc/connect'

/**
 * - gone: the service cannot be reached or broke down; trying again may help
 * - token: a token is needed, or the one given is not known
 * - role: the token's role may not do this
 * - changed: another client was quicker, or the stream was cut off
 * - missing: no such thing (any more)
 * - unsupported: the service does not know the call
 * - refused: the request cannot be met as it is
 * - cancelled: this page took it back
 */
export type Failure = 'gone' | 'token' | 'role' | 'changed' | 'missing' | 'unsupported' | 'refused' | 'cancelled'

const FAILURES: Partial<Record<Code, Failure>> = {
  [Code.Canceled]: 'cancelled',
  [Code.Unauthenticated]: 'token',
  [Code.PermissionDenied]: 'role',
  [Code.Aborted]: 'changed',
  [Code.NotFound]: 'missing',
  [Code.Unimplemented]: 'unsupported',
  [Code.InvalidArgument]: 'refused',
  [Code.FailedPrecondition]: 'refused',
  [Code.OutOfRange]: 'refused',
  [Code.AlreadyExists]: 'refused',
  [Code.ResourceExhausted]: 'refused',
}

export function failureOf(error: unknown): Failure {
  return FAILURES[ConnectError.from(error).code] ?? 'gone'
}

/** Whether calling again, without anything else having changed, can help. */
export function mayPass(failure: Failure): boolean {
  return failure === 'gone' || failure === 'changed'
}

/** A sentence for people. */
export function inWords(error: unknown): string {
  const { code, rawMessage } = ConnectError.from(error)
  if (code === Code.Internal) return `The service failed: ${sentence(rawMessage)}`
  switch (failureOf(error)) {
    case 'gone':
      return `The service does not answer (${rawMessage}).`
    case 'token':
      return 'A token is needed.'
    case 'role':
      return 'Your token does not allow this.'
    case 'unsupported':
      return 'The service is too old for this.'
    case 'cancelled':
      return 'Cancelled.'
    default:
      return sentence(rawMessage)
  }
}

function sentence(text: string): string {
  const trimmed = text.trim()
  if (trimmed === '') return 'The service gave no reason.'
  const capital = trimmed.charAt(0).toUpperCase() + trimmed.slice(1)
  return /[.!?]$/.test(capital) ? capital : `${capital}.`
}
