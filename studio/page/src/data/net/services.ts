// The clients of both services.

import { type Client, createClient } from '@connectrpc/connect'
import { createConnectTransport } from '@connectrpc/connect-web'
import { PlannerService } from '../../gen/surefoot/planner/v1/planner_pb'
import { MapService } from '../../gen/surefoot/world/v1/maps_pb'
import { WorldService } from '../../gen/surefoot/world/v1/world_pb'
import type { ServiceAddress } from './consent'
import { Link } from './link'
import type { Session, Sessions } from './session'

/** One service and the maps that it keeps. */
interface Side {
  /** Its URL. */
  address: string
  /** Whether only a link has named it. */
  isForeign: boolean
  link: Link
  /** The token of its origin. */
  session: Session
  maps: Client<typeof MapService>
}

export interface WorldSide extends Side {
  calls: Client<typeof WorldService>
}

export interface PlannerSide extends Side {
  calls: Client<typeof PlannerService>
}

/** `fetch`: makes the calls, as the browser's does. */
export function connectWorld(address: ServiceAddress, sessions: Sessions, fetch?: typeof globalThis.fetch): WorldSide {
  const { side, transport } = connect(address, sessions, fetch)
  return { ...side, calls: createClient(WorldService, transport) }
}

export function connectPlanner(address: ServiceAddress, sessions: Sessions): PlannerSide {
  const { side, transport } = connect(address, sessions)
  return { ...side, calls: createClient(PlannerService, transport) }
}

function connect({ url, origin, isForeign }: ServiceAddress, sessions: Sessions, fetch = globalThis.fetch) {
  const [link, session] = [new Link(), sessions.at(origin)]
  const interceptors = [link.interceptor, session.interceptor]
  const transport = createConnectTransport({ baseUrl: url, useBinaryFormat: true, interceptors, fetch })
  const side: Side = { address: url, isForeign, link, session, maps: createClient(MapService, transport) }
  return { side, transport }
}
