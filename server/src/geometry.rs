//! A world's map for those who look at it: its triangles tile by tile.

use std::collections::HashMap;
use surefoot_world::mesh::{Surface, Triangle};
use surefoot_world::{Map, Vec3};

/// Side of a tile, m.
const TILE_M: f32 = 64.0;
/// Corners of exact tiles that lie within a cube of this side are one, m.
const WELD_M: f32 = 1.0e-3;

/// A tile as an indexed triangle mesh.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct TileMesh {
    /// Its place along x and z.
    pub place: [u32; 2],
    /// Corners, m.
    pub positions: Vec<Vec3>,
    /// Three for each triangle.
    pub indices: Vec<u32>,
    /// One for each triangle.
    pub surfaces: Vec<Surface>,
}

/// The tiles of one answer, and how their corners are merged.
#[derive(Debug)]
pub struct Tiles {
    /// By place along x and z: indices of the triangles whose centre lies there.
    tiles: Vec<([u32; 2], Vec<u32>)>,
    /// With less detail: the corner of each cell, the mean of those within. It holds across tiles, so no gaps come about.
    merged: Option<(f32, HashMap<[i32; 3], Vec3>)>,
}

impl Tiles {
    /// Sorts a map's triangles into tiles that touch `region`, seen from above (all of them if there is none), with corners
    /// merged within cubes of `cell_m`, if that is above 0.
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

    /// How many there are.
    pub fn count(&self) -> usize {
        self.tiles.len()
    }

    /// One of them, as an indexed mesh.
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
    // Nothing lies outside by more than rounding, and a cast stops at 0.
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
