//! A map's triangles, tile by tile, for display.

use std::collections::HashMap;
use surefoot_world::mesh::{Surface, Triangle};
use surefoot_world::{Map, Vec3};

/// Side of a tile, m.
const TILE_M: f32 = 64.0;
/// Side of the cubes within which vertices are merged at full detail, m.
const WELD_M: f32 = 1.0e-3;

/// A tile as an indexed triangle mesh.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct TileMesh {
    /// Index of the tile along x and z.
    pub place: [u32; 2],
    /// Vertices, m.
    pub positions: Vec<Vec3>,
    /// Indices of vertices, three for each triangle.
    pub indices: Vec<u32>,
    /// Surface of each triangle.
    pub surfaces: Vec<Surface>,
}

/// The tiles of one answer, and how their vertices are merged.
#[derive(Debug)]
pub struct Tiles {
    /// Index of each tile along x and z, and the indices of the triangles with their centre in it.
    tiles: Vec<([u32; 2], Vec<u32>)>,
    /// Reduced detail: side of the cells, m, and the mean of the vertices in each cell. All tiles share the means, so
    /// that there are no gaps between tiles.
    merged: Option<(f32, HashMap<[i32; 3], Vec3>)>,
}

impl Tiles {
    /// Sorts a map's triangles into the tiles that touch `region` in the plan view; `None` means all tiles. Vertices
    /// within a cube of side `cell_m` (m) are merged; 0 means full detail.
    pub fn of(map: &Map, region: Option<[Vec3; 2]>, cell_m: f32) -> Self {
        let triangles = map.mesh().triangles();
        let columns = |extent: f32| (extent / TILE_M).ceil().max(1.0) as usize;
        let (width, depth) = (columns(map.extent().x), columns(map.extent().z));
        let mut tiles = vec![Vec::new(); width * depth];
        for (idx, triangle) in (0..).zip(triangles) {
            let [x, z] = tile_of(triangle, width, depth);
            tiles[z * width + x].push(idx);
        }
        let touches = |[x, z]: [u32; 2]| {
            region.is_none_or(|[low, high]| {
                let within =
                    |at: u32, low: f32, high: f32| at as f32 * TILE_M <= high && (at + 1) as f32 * TILE_M >= low;
                within(x, low.x, high.x) && within(z, low.z, high.z)
            })
        };
        let tiles: Vec<_> = tiles
            .into_iter()
            .enumerate()
            .map(|(at, tile)| ([(at % width) as u32, (at / width) as u32], tile))
            .filter(|(at, tile)| !tile.is_empty() && touches(*at))
            .collect();
        let merged = (cell_m > 0.0).then(|| {
            let shown = tiles.iter().flat_map(|(_, tile)| tile).map(|&idx| &triangles[idx as usize]);
            (cell_m, means(shown, cell_m))
        });
        Self { tiles, merged }
    }

    /// Returns the number of tiles.
    pub fn count(&self) -> usize {
        self.tiles.len()
    }

    /// Returns one tile as an indexed mesh, without the triangles that merging has collapsed.
    pub fn mesh(&self, map: &Map, tile_idx: usize) -> TileMesh {
        let (place, tile) = &self.tiles[tile_idx];
        let mut mesh = TileMesh { place: *place, ..TileMesh::default() };
        let mut known: HashMap<[i32; 3], u32> = HashMap::new();
        for &idx in tile {
            let triangle = &map.mesh().triangles()[idx as usize];
            let keys = triangle.corners().map(|corner| cell_of(corner, self.merged.as_ref().map_or(WELD_M, |it| it.0)));
            if keys[0] == keys[1] || keys[1] == keys[2] || keys[2] == keys[0] {
                continue;
            }
            for (key, corner) in keys.into_iter().zip(triangle.corners()) {
                let next = known.len() as u32;
                let index = *known.entry(key).or_insert_with(|| {
                    let at = self.merged.as_ref().map_or(corner, |(_, means)| means[&key]);
                    mesh.positions.push(at);
                    next
                });
                mesh.indices.push(index);
            }
            mesh.surfaces.push(triangle.surface());
        }
        mesh
    }
}

fn tile_of(triangle: &Triangle, width: usize, depth: usize) -> [usize; 2] {
    let [a, b, c] = triangle.corners();
    let centre = (a + b + c) / 3.0;
    // Centres are outside the map only by rounding, and the cast saturates at 0.
    [((centre.x / TILE_M) as usize).min(width - 1), ((centre.z / TILE_M) as usize).min(depth - 1)]
}

fn cell_of(corner: Vec3, cell_m: f32) -> [i32; 3] {
    (corner / cell_m).round().to_array().map(|value| value as i32)
}

fn means<'a>(triangles: impl Iterator<Item = &'a Triangle>, cell_m: f32) -> HashMap<[i32; 3], Vec3> {
    let mut sums: HashMap<[i32; 3], (Vec3, f32)> = HashMap::new();
    for corner in triangles.flat_map(Triangle::corners) {
        let (sum, count) = sums.entry(cell_of(corner, cell_m)).or_default();
        *sum += corner;
        *count += 1.0;
    }
    sums.into_iter().map(|(key, (sum, count))| (key, sum / count)).collect()
}
