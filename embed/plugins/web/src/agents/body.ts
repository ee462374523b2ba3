// Bodies: what makes one kind of character move unlike another, and how an observation says it.

import { checkCount, checkRange, SurefootError } from '../checks.ts'

/** The body as an observation describes it. Omitted fields default to the body that policies handle best. */
export interface Body {
  /** Height from soles to crown, m. */
  height: number
  /** Radius of the capsule, m. */
  radius: number
  /** Top speed forward, m/s. */
  forwardSpeed: number
  /** Top speed backwards and sideways as a share of `forwardSpeed`. */
  sideSpeedShare: number
  /** Top turning speed, rad/s. */
  turnSpeed: number
  /** Upward speed of a jump, m/s. */
  jumpSpeed: number
  /** Gravity, m/s2. */
  gravity: number
  /** Jumps in the air before the character must land. */
  extraJumps: number
  /** Steepest walkable slope, rad. */
  maxSlope: number
  /** Highest step that is climbed without a jump, m. */
  stepHeight: number
  /** Horizontal acceleration on the ground, m/s2. */
  groundAcceleration: number
  /** Horizontal acceleration in the air, m/s2. */
  airAcceleration: number
  usesZipLines: boolean
  usesJetpacks: boolean
}

/** The body that policies were trained with most: 1.8 m tall, 11 m/s, a double jump, steps of 0.1 m. */
const PAPER_BODY: Readonly<Body> = {
  height: 1.8,
  radius: 0.3,
  forwardSpeed: 11,
  sideSpeedShare: 0.6,
  turnSpeed: Math.PI,
  jumpSpeed: 10,
  gravity: 20,
  extraJumps: 1,
  maxSlope: (35 * Math.PI) / 180,
  stepHeight: 0.1,
  groundAcceleration: 60,
  airAcceleration: 25,
  usesZipLines: true,
  usesJetpacks: true,
}

/** The body of characters unless a game says otherwise: the paper's, with steps as high as stairs have. */
export const DEFAULT_BODY: Readonly<Body> = { ...PAPER_BODY, stepHeight: 0.35 }

/** Features of jumps and of control in the air are at most this, as in training. */
const MOST_TOLD = 4

/**
 * Completes the description of a body.
 * @throws SurefootError that names the first field which is unknown or out of its range.
 */
export function bodyOf(given: Partial<Body> = {}): Body {
  const unknown = Object.keys(given).find((field) => !(field in DEFAULT_BODY))
  if (unknown !== undefined) throw new SurefootError(`body.${unknown} is no field of a body`)
  const body = { ...DEFAULT_BODY, ...given }
  const ranges: [keyof Body, number, number][] = [
    ['radius', 0.15, 1],
    ['height', 2 * body.radius, 4],
    ['forwardSpeed', 0.1, 20],
    ['sideSpeedShare', 0, 1],
    ['turnSpeed', 0.1, 20],
    ['jumpSpeed', 0, 30],
    ['gravity', 1, 100],
    ['maxSlope', 0, 1.4],
    ['stepHeight', 0, body.height / 2],
    ['groundAcceleration', 1, 1000],
    ['airAcceleration', 0, 1000],
  ]
  for (const [field, least, most] of ranges) checkRange(`body.${field}`, body[field], least, most)
  checkCount('body.extraJumps', body.extraJumps, 0, 255)
  return body
}

/** Tells what body a character has, relative to the paper's, whose features are all 0. */
export function bodyFeatures(body: Body): number[] {
  const usual = PAPER_BODY
  const ratio = (field: 'height' | 'radius' | 'forwardSpeed' | 'turnSpeed' | 'gravity' | 'groundAcceleration') =>
    Math.log(body[field] / usual[field])
  const jumpM = ({ jumpSpeed, gravity }: Body) => (0.5 * jumpSpeed * jumpSpeed) / gravity
  return [
    ratio('height'),
    ratio('radius'),
    ratio('forwardSpeed'),
    body.sideSpeedShare - usual.sideSpeedShare,
    ratio('turnSpeed'),
    Math.min((jumpM(body) - jumpM(usual)) / 2.5, MOST_TOLD),
    ratio('gravity'),
    Math.min(body.extraJumps, MOST_TOLD) - usual.extraJumps,
    (body.maxSlope - usual.maxSlope) / usual.maxSlope,
    (body.stepHeight - usual.stepHeight) / 0.3,
    ratio('groundAcceleration'),
    Math.min((body.airAcceleration - usual.airAcceleration) / 25, MOST_TOLD),
    body.usesZipLines ? 0 : -1,
    body.usesJetpacks ? 0 : -1,
  ]
}
