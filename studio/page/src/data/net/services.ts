// The clients of both services.

import { type Client, createClient, type Transport } from '@connectrpc/connect'
import { createGrpcWebTransport } from '@connectrpc/connect-web'
import { PlannerService } from '../../gen/surefoot/planner/v1/planner_pb'
import { MapService } from '../../gen/surefoot/world/v1/maps_pb'
import { WorldService } from '../../gen/surefoot/world/v1/world_pb'
import { Link } from './link'
import type { Session } from './session'

/** One service and the maps that it keeps. */
export interface WorldSide {
  address: string
  link: Link
  calls: Client<typeof WorldService>
  maps: Client<typeof MapService>
}

export interface PlannerSide {
  address: string
  link: Link
  calls: Client<typeof PlannerService>
  maps: Client<typeof MapService>
}

export function connectWorld(address: string, session: Session): WorldSide {
  const link = new Link()
  const transport = transportTo(address, session, link)
  return {
    address,
    link,
    calls: createClient(WorldService, transport),
    maps: createClient(MapService, transport),
  }
}

export function connectPlanner(address: string, session: Session): PlannerSide {
  const link = new Link()
  const transport = transportTo(address, session, link)
  return {
    address,
    link,
    calls: createClient(PlannerService, transport),
    maps: createClient(MapService, transport),
  }
}

function transportTo(baseUrl: string, session: Session, link: Link): Transport {
  return createGrpcWebTransport({ baseUrl, interceptors: [link.interceptor, session.interceptor] })
}
