// Bakes a NavMesh for the body of a challenge's characters, as a studio would, and joins links to it.

import * as recast from '@recast-navigation/core'
import { getBoundingBox } from '@recast-navigation/generators'

/** Side and height of the voxels that Recast makes of a level, m. */
const CELL_M = 0.25
const CELL_HEIGHT_M = 0.2
/**
 * Highest step of the agent, m, for bodies that climb less. Recast calls a slope too steep if the floor rises by more than this from a cell's
 * one neighbour to its other one. The default body walks up 35 degrees, which is 0.35 m in two cells; a climb that is as low as its own steps
 * of 0.1 m would therefore remove most slopes. It is also what engines have by default (0.35 to 0.45 m).
 */
const LEAST_CLIMB_M = 0.4
/** Area of ground where an agent would rather not walk, and how many times as long a path is there. */
const AVOIDED_AREA = 40
const AVOIDED_COST = 10
/** Areas of links that cost more than walking as far: area 1 costs the same, each next one this many times as much as the one before. */
const PRICED_AREAS = 39
const PRICE_STEP = 2 ** 0.25
/** Detour's vertex indices have 16 bits; a link takes two of them. */
const MOST_VERTICES = 0xffff

/** Recast's parameters for a body. */
export function agentOf(body) {
  return {
    cs: CELL_M,
    ch: CELL_HEIGHT_M,
    walkableHeight: Math.ceil(body.height / CELL_HEIGHT_M),
    walkableClimb: Math.round(Math.max(LEAST_CLIMB_M, body.step_height) / CELL_HEIGHT_M),
    // The nearest whole number: 0.25 m for a radius of 0.3 m. Rounded up to 0.5 m, doors of 1.2 m would be closed.
    walkableRadius: Math.max(1, Math.round(body.radius / CELL_M)),
    walkableSlopeAngle: (body.max_slope * 180) / Math.PI,
    // Small islands stay: links may lead to them.
    minRegionArea: 0,
  }
}

/** A baked level, which links can be joined to without baking it again. */
export class Baked {
  #polygons
  #detail

  constructor(level, agent, volumes) {
    this.agent = agent
    const config = { ...recast.recastConfigDefaults, ...agent }
    const context = new recast.RecastBuildContext()
    const fields = open(context, level, config)
    for (const volume of volumes) mark(context, fields, volume, agent)
    ;[this.#polygons, this.#detail] = polygonsOf(context, fields, config)
    recast.freeCompactHeightfield(fields)
  }

  /** A NavMesh with links, each a connection of recast-navigation; its index is the connection's user id. */
  navMesh(links) {
    if (this.#polygons.nverts() + 2 * links.length >= MOST_VERTICES) {
      throw new Error(`a NavMesh of one tile holds ${MOST_VERTICES} vertices, the level with ${links.length} links has more`)
    }
    const { ch, cs, walkableClimb, walkableHeight, walkableRadius } = this.agent
    const params = new recast.NavMeshCreateParams()
    params.setPolyMeshCreateParams(this.#polygons)
    params.setPolyMeshDetailCreateParams(this.#detail)
    params.setWalkableHeight(walkableHeight * ch)
    params.setWalkableRadius(walkableRadius * cs)
    params.setWalkableClimb(walkableClimb * ch)
    params.setCellSize(cs)
    params.setCellHeight(ch)
    params.setBuildBvTree(true)
    // Recast's floors are up to two cells above the ground. Without this, Detour drops links that begin on the lowest floor of a level.
    const raised = ({ x, y, z }) => ({ x, y: y + ch, z })
    const connection = ({ startPosition, endPosition, radius, bidirectional, area }, userId) => {
      return { startPosition: raised(startPosition), endPosition: raised(endPosition), radius, bidirectional, area, userId }
    }
    params.setOffMeshConnections(links.map(connection))
    const { navMeshData } = must(recast.createNavMeshData(params), 'Detour refuses the polygons')
    const navMesh = new recast.NavMesh()
    must(navMesh.initSolo(navMeshData), 'Detour refuses the tile')
    return navMesh
  }

  free() {
    recast.freePolyMesh(this.#polygons)
    recast.freePolyMeshDetail(this.#detail)
  }
}

function must(result, message) {
  if (!result || result.success === false) throw new Error(message)
  return result
}

/** The open space of a level, as far from walls and ledges as the agent's radius. */
function open(context, { positions, indices }, config) {
  const { bbMin, bbMax } = getBoundingBox(positions, indices)
  const { width, height } = recast.calcGridSize(bbMin, bbMax, config.cs)
  const { walkableClimb, walkableHeight } = config
  const solid = recast.allocHeightfield()
  must(recast.createHeightfield(context, solid, width, height, bbMin, bbMax, config.cs, config.ch), 'no room for the voxels')
  rasterize(context, { positions, indices }, config, solid)
  recast.filterLowHangingWalkableObstacles(context, walkableClimb, solid)
  recast.filterLedgeSpans(context, walkableHeight, walkableClimb, solid)
  recast.filterWalkableLowHeightSpans(context, walkableHeight, solid)
  const fields = recast.allocCompactHeightfield()
  must(recast.buildCompactHeightfield(context, walkableHeight, walkableClimb, solid, fields), 'no room for the open space')
  recast.freeHeightfield(solid)
  must(recast.erodeWalkableArea(context, config.walkableRadius, fields), 'the level cannot be eroded')
  return fields
}

function rasterize(context, { positions, indices }, config, solid) {
  const vertices = new recast.VerticesArray()
  vertices.copy(positions)
  const triangles = new recast.TrianglesArray()
  triangles.copy(indices)
  const areas = new recast.TriangleAreasArray()
  const [vertexCount, count] = [positions.length / 3, indices.length / 3]
  areas.resize(count)
  recast.markWalkableTriangles(context, config.walkableSlopeAngle, vertices, vertexCount, triangles, count, areas)
  must(recast.rasterizeTriangles(context, vertices, vertexCount, triangles, areas, count, solid, config.walkableClimb), 'no room for the triangles')
  for (const array of [vertices, triangles, areas]) array.destroy()
}

/** Takes lava out of the open space, and makes paths go round water and devices, as a level designer's volumes do. */
function mark(context, fields, { kind, low, high, centre: [x, z], half, radius }, { cs, ch, walkableRadius }) {
  const area = kind === 'lava' ? recast.Recast.RC_NULL_AREA : AVOIDED_AREA
  // The body must not touch what the volume holds; voxels round floors up by as much as one cell.
  const margin = walkableRadius * cs
  const [bottom, top] = [low - ch, high + ch]
  if (half === undefined) {
    recast.markCylinderArea(context, [x, bottom, z], radius + margin, top - bottom, area, fields)
  } else {
    const [wide, long] = half.map((side) => side + margin)
    recast.markBoxArea(context, [x - wide, bottom, z - long], [x + wide, top, z + long], area, fields)
  }
}

/** Convex polygons of the open space, and their heights in detail. */
function polygonsOf(context, fields, config) {
  // Areas of regions are given as sides of squares, and the detail's distances in cells, as in RecastDemo.
  const [least, merged] = [config.minRegionArea ** 2, config.mergeRegionArea ** 2]
  must(recast.buildDistanceField(context, fields), 'no room for the distances')
  must(recast.buildRegions(context, fields, 0, least, merged), 'no room for the regions')
  const contours = recast.allocContourSet()
  const { maxSimplificationError, maxEdgeLen, maxVertsPerPoly } = config
  const walls = recast.Recast.RC_CONTOUR_TESS_WALL_EDGES
  must(recast.buildContours(context, fields, maxSimplificationError, maxEdgeLen, contours, walls), 'no room for the contours')
  const polygons = recast.allocPolyMesh()
  must(recast.buildPolyMesh(context, contours, maxVertsPerPoly, polygons), 'no room for the polygons')
  recast.freeContourSet(contours)
  const detail = recast.allocPolyMeshDetail()
  const [distance, error] = [config.cs * config.detailSampleDist, config.ch * config.detailSampleMaxError]
  must(recast.buildPolyMeshDetail(context, polygons, fields, distance, error, detail), 'no room for the heights')
  for (let polygon = 0; polygon < polygons.npolys(); polygon += 1) {
    if (polygons.areas(polygon) === recast.Recast.RC_WALKABLE_AREA) polygons.setAreas(polygon, 0)
    polygons.setFlags(polygon, 1)
  }
  return [polygons, detail]
}

/** Area of links where a path costs `price` times its length: Detour has prices of areas only, not of connections. */
export function areaOfPrice(price) {
  const step = Math.round(Math.log(price) / Math.log(PRICE_STEP))
  return Math.min(PRICED_AREAS, 1 + Math.max(0, step))
}

/** The filter of queries: everything is allowed, at the prices of the areas. */
export function filter() {
  const filter = new recast.QueryFilter()
  filter.includeFlags = 0xffff
  filter.excludeFlags = 0
  return priceAreas(filter)
}

/** Sets the prices of all areas in a filter, and returns it. */
export function priceAreas(filter) {
  for (let area = 1; area <= PRICED_AREAS; area += 1) filter.setAreaCost(area, PRICE_STEP ** (area - 1))
  filter.setAreaCost(AVOIDED_AREA, AVOIDED_COST)
  return filter
}

/** Edges of a NavMesh that no other polygon adjoins, each with the direction that leads away from its polygon. */
export function boundary(navMesh) {
  const tile = navMesh.getTile(0)
  const vertex = (index) => [0, 1, 2].map((axis) => tile.verts(3 * index + axis))
  const edges = []
  for (let index = 0; index < tile.header().polyCount(); index += 1) {
    const polygon = tile.polys(index)
    const corners = Array.from({ length: polygon.vertCount() }, (_, at) => vertex(polygon.verts(at)))
    // An off-mesh connection is a polygon of two vertices, and has no edges.
    if (corners.length < 3) continue
    corners.forEach((from, at) => {
      if (polygon.neis(at) === 0) edges.push(edgeOf(from, corners[(at + 1) % corners.length], corners))
    })
  }
  return edges
}

function edgeOf(from, to, corners) {
  const [dx, dz] = [to[0] - from[0], to[2] - from[2]]
  const length = Math.hypot(dx, dz)
  const [x, z] = [0, 2].map((axis) => corners.reduce((sum, corner) => sum + corner[axis], 0) / corners.length)
  const side = Math.sign(dz * (x - from[0]) - dx * (z - from[2])) || 1
  return { from, to, outward: length > 0 ? [(-side * dz) / length, (side * dx) / length] : [0, 0] }
}
