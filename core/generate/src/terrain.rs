//! The density lattice and the extraction of its iso-surface.
//!
//! Density is positive inside rock. It is sampled on a lattice of [`VOXEL_M`]; the surface is extracted by
//! naive surface nets (Gibson 1998): one vertex per cell that the surface crosses, one quad per lattice edge
//! that changes sign.

use noise::{NoiseFn, Perlin};
use rayon::prelude::*;
use surefoot_world::float::hypot;
use surefoot_world::map::MapSize;
use surefoot_world::{Vec3, parallel};

/// Spacing of the density lattice in metres.
pub(crate) const VOXEL_M: f32 = 1.25;
/// Height of the rock floor below every map, in metres (as in the released environment).
const FLOOR_M: f32 = 1.5;
/// Factor by which the lattice of the noise is coarser; the noise is interpolated in between.
const NOISE_STRIDE: usize = 2;

/// Mean height of the terrain on a map of [`REFERENCE_HEIGHT_M`], m.
const BASE_HEIGHT_M: f32 = 26.0;
/// Height of the default map, m. Lower maps flatten the octaves; higher ones get an additional swell.
const REFERENCE_HEIGHT_M: f32 = 80.0;
/// Wavelength of the swell, m; its amplitude and the rise of the mean height, both per metre above the reference
/// height.
const SWELL: (f64, f32, f32) = (420.0, 0.45, 0.3);
/// (wavelength m, amplitude m) of each octave of 3D Perlin noise.
const OCTAVES: [(f64, f32); 3] = [(95.0, 34.0), (33.0, 12.0), (13.0, 1.6)];
/// Range of the height of a terrace, m, drawn for each map: a double jump (5 m) climbs the risers of low terraces,
/// while high ones call for a detour or a device.
const TERRACE_M: (f32, f32) = (5.2, 8.0);
/// Wavelength of the noise that decides where the ground is terraced and where it rises smoothly, m.
const TERRACING_WAVELENGTH_M: f64 = 60.0;
/// Mean and gain of that noise before it is clamped to [0, 1]: smooth slopes are rare, so that most of the map is not
/// connected on foot.
const TERRACING: (f32, f32) = (3.0, 2.4);
/// Share of a terrace's height that lies in its nearly level tread.
const TREAD_HEIGHT_SHARE: f32 = 0.14;
/// Share of the terrain's rise that lies in the tread; the rest lies in the riser.
const TREAD_RISE_SHARE: f32 = 0.89;

/// Streams of the seed, after those of the octaves and the terracing.
const TERRACE_STREAM: u64 = OCTAVES.len() as u64 + 1;
const SWELL_STREAM: u64 = OCTAVES.len() as u64 + 2;

/// Density samples over a map's whole volume.
pub(crate) struct Lattice {
    counts: [usize; 3],
    values: Vec<f32>,
}

impl Lattice {
    /// Samples the terrain of `seed` over `size` on `thread_count` threads, with equal bits for any number of threads.
    pub(crate) fn sample(seed: u64, size: MapSize, thread_count: usize) -> Self {
        let counts = [size.width, size.height, size.depth].map(|extent| (extent as f32 / VOXEL_M).ceil() as usize + 1);
        let relief = Relief::new(seed, size.height as f32);
        let terraces = Terraces::new(seed);
        let values = parallel::with_threads(thread_count, || {
            let coarse = CoarseNoise::sample(&relief, counts);
            let mut values = vec![0.0f32; counts.iter().product()];
            values.par_chunks_mut(counts[0] * counts[1]).enumerate().for_each(|(z, slab)| {
                let shares: Vec<f32> = (0..counts[0]).map(|x| terraces.share(x, z)).collect();
                for (y, row) in slab.chunks_mut(counts[0]).enumerate() {
                    let height = y as f32 * VOXEL_M;
                    let terraced = terraces.warp(height);
                    for (x, value) in row.iter_mut().enumerate() {
                        let terrain = relief.base + coarse.at([x, y, z]) - (height + (terraced - height) * shares[x]);
                        *value = terrain.max(FLOOR_M - height);
                    }
                }
            });
            values
        });
        Self { counts, values }
    }

    fn idx(&self, x: usize, y: usize, z: usize) -> usize {
        (z * self.counts[1] + y) * self.counts[0] + x
    }

    /// Rewrites the density of every lattice point within `radius` of the vertical line through (`x`, `z`).
    ///
    /// `edit` receives the distance to the line (m), the height (m) and the density, and returns the new density.
    pub(crate) fn edit_column(&mut self, x: f32, z: f32, radius: f32, edit: impl Fn(f32, f32, f32) -> f32) {
        let top = self.counts[1] as f32 * VOXEL_M;
        self.edit_box(
            Vec3::new(x - radius, 0.0, z - radius),
            Vec3::new(x + radius, top, z + radius),
            |point, density| {
                let distance = hypot(point.x - x, point.z - z);
                if distance > radius { density } else { edit(distance, point.y, density) }
            },
        );
    }

    /// Rewrites the density of every lattice point in a box; `edit` receives the point and its density.
    pub(crate) fn edit_box(&mut self, low: Vec3, high: Vec3, edit: impl Fn(Vec3, f32) -> f32) {
        let range = |axis: usize| {
            let first = (low[axis] / VOXEL_M).floor().max(0.0) as usize;
            let last = ((high[axis] / VOXEL_M).ceil().max(0.0) as usize).min(self.counts[axis] - 1);
            first..=last
        };
        for k in range(2) {
            for j in range(1) {
                for i in range(0) {
                    let point = Vec3::new(i as f32, j as f32, k as f32) * VOXEL_M;
                    let idx = self.idx(i, j, k);
                    self.values[idx] = edit(point, self.values[idx]);
                }
            }
        }
    }

    /// Height of the uppermost surface at (`x`, `z`), m, linearly interpolated along the nearest column.
    pub(crate) fn top(&self, x: f32, z: f32) -> f32 {
        let column = |value: f32, count: usize| ((value / VOXEL_M).round().max(0.0) as usize).min(count - 1);
        let (i, k) = (column(x, self.counts[0]), column(z, self.counts[2]));
        let mut above = self.values[self.idx(i, self.counts[1] - 1, k)];
        for j in (0..self.counts[1] - 1).rev() {
            let here = self.values[self.idx(i, j, k)];
            if here > 0.0 && above <= 0.0 {
                return (j as f32 + here / (here - above)) * VOXEL_M;
            }
            above = here;
        }
        FLOOR_M
    }

    /// Extracts the iso-surface as triangles with outward normals (counter-clockwise seen from the air).
    pub(crate) fn surface(&self) -> Vec<[Vec3; 3]> {
        let [columns, rows, layers] = self.counts.map(|count| count - 1);
        let mut triangles = Vec::new();
        // Two layers of cells suffice: a quad around an edge joins cells of this layer and the previous one.
        let mut previous = vec![None; columns * rows];
        let mut current = previous.clone();
        for z in 0..layers {
            for y in 0..rows {
                for x in 0..columns {
                    current[y * columns + x] = self.cell_vertex(x, y, z);
                }
            }
            for y in 0..rows {
                for x in 0..columns {
                    self.push_quads([x, y, z], [&previous, &current], &mut triangles);
                }
            }
            std::mem::swap(&mut previous, &mut current);
        }
        triangles
    }

    /// Pushes the quads around the edges that lead from a lattice point along each axis. `layers` are the vertices of
    /// the cells below and above the point along z.
    fn push_quads(&self, [x, y, z]: [usize; 3], layers: [&[Option<Vec3>]; 2], triangles: &mut Vec<[Vec3; 3]>) {
        let [previous, current] = layers;
        let at = |layer: &[Option<Vec3>], x: usize, y: usize| {
            layer[y * (self.counts[0] - 1) + x].expect("the surface passes through all cells around an edge it crosses")
        };
        let value = |x: usize, y: usize, z: usize| self.values[self.idx(x, y, z)];
        let here = value(x, y, z);
        if y > 0 && z > 0 {
            let quad = || [at(previous, x, y - 1), at(current, x, y - 1), at(current, x, y), at(previous, x, y)];
            push_quad(triangles, here, value(x + 1, y, z), quad, true);
        }
        if x > 0 && z > 0 {
            let quad = || [at(previous, x - 1, y), at(current, x - 1, y), at(current, x, y), at(previous, x, y)];
            push_quad(triangles, here, value(x, y + 1, z), quad, false);
        }
        if x > 0 && y > 0 {
            let quad = || [at(current, x - 1, y - 1), at(current, x, y - 1), at(current, x, y), at(current, x - 1, y)];
            push_quad(triangles, here, value(x, y, z + 1), quad, false);
        }
    }

    /// The mean of the edge crossings of one cell, m; `None` if the surface does not pass through the cell.
    fn cell_vertex(&self, x: usize, y: usize, z: usize) -> Option<Vec3> {
        const CORNERS: [[usize; 3]; 8] =
            [[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0], [0, 0, 1], [1, 0, 1], [0, 1, 1], [1, 1, 1]];
        const EDGES: [(usize, usize); 12] =
            [(0, 1), (2, 3), (4, 5), (6, 7), (0, 2), (1, 3), (4, 6), (5, 7), (0, 4), (1, 5), (2, 6), (3, 7)];
        let values = CORNERS.map(|[dx, dy, dz]| self.values[self.idx(x + dx, y + dy, z + dz)]);
        let solid_count = values.iter().filter(|&&value| value > 0.0).count();
        if solid_count == 0 || solid_count == 8 {
            return None;
        }
        let mut sum = Vec3::ZERO;
        let mut crossing_count = 0.0f32;
        for (a, b) in EDGES {
            if (values[a] > 0.0) != (values[b] > 0.0) {
                let t = values[a] / (values[a] - values[b]);
                let corner = |i: usize| Vec3::from_array(CORNERS[i].map(|c| c as f32));
                sum += corner(a) + (corner(b) - corner(a)) * t;
                crossing_count += 1.0;
            }
        }
        let base = Vec3::new(x as f32, y as f32, z as f32);
        Some((base + sum / crossing_count) * VOXEL_M)
    }
}

/// Pushes two triangles around a lattice edge from `here` to `there`, facing the air, if the density changes sign.
fn push_quad(triangles: &mut Vec<[Vec3; 3]>, here: f32, there: f32, quad: impl Fn() -> [Vec3; 4], flip: bool) {
    if (here > 0.0) == (there > 0.0) {
        return;
    }
    let [a, b, c, d] = quad();
    let faces_along_edge = here > 0.0;
    if faces_along_edge != flip {
        triangles.extend([[a, b, c], [a, c, d]]);
    } else {
        triangles.extend([[a, c, b], [a, d, c]]);
    }
}

/// The noise that raises and lowers the terrain around its mean height.
struct Relief {
    octaves: Vec<Perlin>,
    /// Factor of the octaves: lower maps flatten them.
    gain: f32,
    /// The swell of maps above the reference height, and its amplitude, m.
    swell: Option<(Perlin, f32)>,
    /// Mean height of the terrain, m.
    base: f32,
}

impl Relief {
    fn new(seed: u64, map_height: f32) -> Self {
        let spare = map_height - REFERENCE_HEIGHT_M;
        let octaves = (0..OCTAVES.len()).map(|octave| Perlin::new(mix_seed(seed, octave as u64))).collect();
        let swell = (spare > 0.0).then(|| (Perlin::new(mix_seed(seed, SWELL_STREAM)), SWELL.1 * spare));
        let base = BASE_HEIGHT_M + if spare > 0.0 { SWELL.2 * spare } else { 0.25 * spare };
        Self { octaves, gain: (1.0 + spare.min(0.0) / 65.0).max(0.3), swell, base }
    }

    /// Height added to the mean at a point, m.
    fn at(&self, point: [f64; 3]) -> f32 {
        let octave = |(noise, (wavelength, amplitude)): (&Perlin, (f64, f32))| {
            self.gain * amplitude * noise.get(point.map(|c| c / wavelength + 0.5)) as f32
        };
        let sum: f32 = self.octaves.iter().zip(OCTAVES).map(octave).sum();
        let swell = |(noise, amplitude): &(Perlin, f32)| amplitude * noise.get(point.map(|c| c / SWELL.0 + 0.5)) as f32;
        sum + self.swell.as_ref().map_or(0.0, swell)
    }
}

/// The relief on a lattice that is coarser by [`NOISE_STRIDE`].
struct CoarseNoise {
    counts: [usize; 3],
    values: Vec<f32>,
}

impl CoarseNoise {
    /// Covers a fine lattice of these counts.
    fn sample(relief: &Relief, fine_counts: [usize; 3]) -> Self {
        let counts = fine_counts.map(|count| count.div_ceil(NOISE_STRIDE) + 1);
        let mut values = vec![0.0f32; counts.iter().product()];
        values.par_chunks_mut(counts[0] * counts[1]).enumerate().for_each(|(z, slab)| {
            for (idx, value) in slab.iter_mut().enumerate() {
                let cell = [idx % counts[0], idx / counts[0], z];
                *value = relief.at(cell.map(|i| (i * NOISE_STRIDE) as f64 * f64::from(VOXEL_M)));
            }
        });
        Self { counts, values }
    }

    /// Trilinear interpolation at a point of the fine lattice.
    fn at(&self, fine: [usize; 3]) -> f32 {
        let cell = fine.map(|i| i / NOISE_STRIDE);
        let [tx, ty, tz] = fine.map(|i| (i % NOISE_STRIDE) as f32 / NOISE_STRIDE as f32);
        let at = |dx: usize, dy: usize, dz: usize| {
            self.values[((cell[2] + dz) * self.counts[1] + cell[1] + dy) * self.counts[0] + cell[0] + dx]
        };
        let lerp = |a: f32, b: f32, t: f32| a + (b - a) * t;
        let face = |dz: usize| lerp(lerp(at(0, 0, dz), at(1, 0, dz), tx), lerp(at(0, 1, dz), at(1, 1, dz), tx), ty);
        lerp(face(0), face(1), tz)
    }
}

/// Terraces: where the ground is stepped, and how high the steps are.
struct Terraces {
    noise: Perlin,
    /// Height of a terrace, m.
    height: f32,
}

impl Terraces {
    fn new(seed: u64) -> Self {
        let share = f32::from((mix_seed(seed, TERRACE_STREAM) >> 16) as u16) / f32::from(u16::MAX);
        let height = TERRACE_M.0 + (TERRACE_M.1 - TERRACE_M.0) * share;
        Self { noise: Perlin::new(mix_seed(seed, OCTAVES.len() as u64)), height }
    }

    /// How far a column of the lattice is terraced, from 0 (smooth) to 1.
    fn share(&self, x: usize, z: usize) -> f32 {
        let point = [x, z].map(|i| i as f64 * f64::from(VOXEL_M) / TERRACING_WAVELENGTH_M + 0.5);
        (TERRACING.0 + TERRACING.1 * self.noise.get(point) as f32).clamp(0.0, 1.0)
    }

    /// Maps a height to the noise that puts the surface there, m. Most of the range of the noise falls in treads, so
    /// that the ground there is nearly level.
    fn warp(&self, height: f32) -> f32 {
        let step = (height / self.height).floor();
        let t = height / self.height - step;
        let warped = if t < TREAD_HEIGHT_SHARE {
            t / TREAD_HEIGHT_SHARE * TREAD_RISE_SHARE
        } else {
            TREAD_RISE_SHARE + (t - TREAD_HEIGHT_SHARE) / (1.0 - TREAD_HEIGHT_SHARE) * (1.0 - TREAD_RISE_SHARE)
        };
        (step + warped) * self.height
    }
}

/// Mixes a 64-bit seed and a stream number into the 32-bit seed of the noise crate (SplitMix64).
fn mix_seed(seed: u64, stream: u64) -> u32 {
    let mut z = seed.wrapping_add(stream.wrapping_add(1).wrapping_mul(0x9E37_79B9_7F4A_7C15));
    z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    ((z ^ (z >> 31)) >> 32) as u32
}
