//! Generates a [`Map`] from a [`MapSpec`], in phases: terrain, cuts, structures, devices, the repair of ground without
//! an entrance or exit, and movers.

mod buildings;
mod built;
mod furnish;
mod repair;
mod stage;
mod terrain;

use buildings::{MIN_HOUSE_HALF, STOREY_M};
use noise::{NoiseFn, Perlin};
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
pub use stage::Stage;
use stage::{count_on, pad};
use std::f32::consts::TAU;
use surefoot_world::Vec3;
use surefoot_world::float::hypot;
use surefoot_world::map::features::{JETPACK_FUEL_S, PAD_EXTRA_M};
use surefoot_world::map::{
    Building, Cave, CollisionMap, DISC_RADIUS_M, Jetpack, Liquid, Map, MapKind, MapSpec, Outline, Pad, Placed, Plateau,
    Pool, Ravine,
};
use surefoot_world::mesh::{Surface, Triangle};
use terrain::{Lattice, VOXEL_M};

/// Number of instances of each feature on the default map at density 1.
const PLATEAU_COUNT: f32 = 12.0;
const BUILDING_COUNT: f32 = 16.0;
const WATER_COUNT: f32 = 6.0;
const LAVA_COUNT: f32 = 5.0;
const PAD_COUNT: f32 = 4.0;
/// Pads at the foot of cliffs.
const CLIFF_PAD_COUNT: f32 = 16.0;
const RAVINE_COUNT: f32 = 2.0;
const CAVE_COUNT: f32 = 4.0;
const JETPACK_COUNT: f32 = 5.0;
/// Holes in open terrain.
const HOLE_COUNT: f32 = 8.0;
/// Smallest distance of a feature from the rim of the map, m.
const RIM_M: f32 = 14.0;
/// Highest rise without a pad, m: a double jump reaches 5 m.
const JUMPABLE_M: f32 = 4.4;

/// Generates the map of `spec` on all cores.
pub fn generate(spec: &MapSpec) -> Map {
    let core_count = std::thread::available_parallelism().map_or(1, usize::from);
    generate_with(spec, core_count, |_| {})
}

/// Generates the map of `spec` on `thread_count` threads and calls `progress` at the start of each stage. The bits of
/// the map do not depend on the number of threads.
pub fn generate_with(spec: &MapSpec, thread_count: usize, mut progress: impl FnMut(Stage)) -> Map {
    let mut placer = Placer::new(spec);
    progress(Stage::Terrain);
    let (triangles, placed) = match built::triangles(spec) {
        Some(built) => {
            progress(Stage::Features);
            progress(Stage::Mesh);
            built
        }
        None => placer.terrain(thread_count, &mut progress),
    };
    let bare = CollisionMap::new(Some(*spec), spec.size, triangles, placed);
    let map = Map::new(repair::connect(bare, spec, &mut placer.rng, thread_count, &mut progress));
    let movers = furnish::movers(&map, spec);
    progress(Stage::Done);
    map.with_movers(movers).expect("movers that were placed are valid")
}

/// Places features so that they do not overlap.
struct Placer {
    spec: MapSpec,
    rng: ChaCha8Rng,
    /// Discs (x, z, radius) that features occupy, m.
    occupied: Vec<(f32, f32, f32)>,
}

impl Placer {
    fn new(spec: &MapSpec) -> Self {
        // A separate stream, so that terrain and placements do not share random numbers.
        let mut rng = ChaCha8Rng::seed_from_u64(spec.seed);
        rng.set_stream(1);
        Self { spec: *spec, rng, occupied: Vec::new() }
    }

    /// The solid triangles of terrain, and what is placed on it.
    fn terrain(&mut self, thread_count: usize, progress: &mut impl FnMut(Stage)) -> (Vec<Triangle>, Placed) {
        let mut lattice = Lattice::sample(self.spec.seed, self.spec.size, thread_count);
        progress(Stage::Features);
        if self.spec.kind == MapKind::Open {
            self.open(&mut lattice);
        }
        let mut placed = Placed::default();
        placed.ravines = self.ravines(&mut lattice);
        placed.plateaus = self.plateaus(&mut lattice);
        placed.pools = self.pools(&mut lattice);
        placed.buildings = self.buildings(&mut lattice);
        placed.caves = self.caves(&mut lattice);
        placed.pads = self.pads(&lattice, &placed);
        placed.jetpacks = self.jetpacks(&lattice, &placed);
        progress(Stage::Mesh);
        let mut triangles: Vec<Triangle> =
            lattice.surface().into_iter().filter_map(|corners| Triangle::new(corners, Surface::Ground)).collect();
        drop(lattice);
        buildings::add(&placed.buildings, &mut triangles);
        (triangles, placed)
    }

    /// Cuts the ground off along a winding border and in a few holes.
    fn open(&mut self, lattice: &mut Lattice) {
        const BORDER_M: std::ops::Range<f32> = 4.0..RIM_M - 1.0;
        const WAVELENGTH_M: f64 = 30.0;
        let noise = Perlin::new(self.rng.random());
        let size = self.spec.size.extent();
        lattice.edit_box(Vec3::ZERO, size + Vec3::splat(VOXEL_M), |point, density| {
            let inside = point.x.min(point.z).min(size.x - point.x).min(size.z - point.z);
            if inside > BORDER_M.end {
                return density;
            }
            let share =
                0.5 + 0.5 * noise.get([f64::from(point.x) / WAVELENGTH_M, f64::from(point.z) / WAVELENGTH_M]) as f32;
            density.min(inside - (BORDER_M.start + share * (BORDER_M.end - BORDER_M.start)))
        });
        for _ in 0..self.count(HOLE_COUNT, 1.0) {
            let radius = self.rng.random_range(3.0..9.0);
            let Some((x, z)) = self.spot(radius) else { continue };
            lattice.edit_column(x, z, radius + 2.0 * VOXEL_M, |distance, _, density| density.min(distance - radius));
            self.occupied.push((x, z, radius));
        }
    }

    fn count(&self, reference: f32, density: f32) -> usize {
        count_on(&self.spec, reference, density)
    }

    /// Centre (x, z) of a free disc of `radius`, m; `None` if forty draws found none.
    fn spot(&mut self, radius: f32) -> Option<(f32, f32)> {
        let (width, depth) = (self.spec.size.width as f32, self.spec.size.depth as f32);
        let rim = RIM_M.max(radius + 2.0);
        for _ in 0..40 {
            let x = self.rng.random_range(rim..width - rim);
            let z = self.rng.random_range(rim..depth - rim);
            if self.is_free(x, z, radius) {
                return Some((x, z));
            }
        }
        None
    }

    fn is_free(&self, x: f32, z: f32, radius: f32) -> bool {
        self.occupied.iter().all(|&(other_x, other_z, other_radius)| {
            let (dx, dz, gap) = (x - other_x, z - other_z, radius + other_radius + 1.0);
            dx * dx + dz * dz > gap * gap
        })
    }

    /// Places winding cuts whose floor is 8 to 14 m below the ground at their start.
    fn ravines(&mut self, lattice: &mut Lattice) -> Vec<Ravine> {
        const STEP_M: f32 = 4.0;
        let (width, depth) = (self.spec.size.width as f32, self.spec.size.depth as f32);
        let mut ravines = Vec::new();
        for _ in 0..self.count(RAVINE_COUNT, self.spec.features.ravines) {
            let Some((mut x, mut z)) = self.spot(4.0) else { continue };
            let bottom = (lattice.top(x, z) - self.rng.random_range(8.0..14.0)).max(4.0);
            let half_width = self.rng.random_range(2.5..4.0f32);
            let mut heading = self.rng.random_range(0.0..TAU);
            let mut path = Vec::new();
            for _ in 0..self.rng.random_range(14..30) {
                path.push(Vec3::new(x, bottom, z));
                heading += self.rng.random_range(-0.45..0.45f32);
                let (sin, cos) = libm::sincosf(heading);
                (x, z) = (x + sin * STEP_M, z + cos * STEP_M);
                if x < RIM_M || z < RIM_M || x > width - RIM_M || z > depth - RIM_M {
                    break;
                }
            }
            for point in &path {
                lattice.edit_column(point.x, point.z, half_width + STEP_M, |distance, height, density| {
                    // Walls lean out by a fifth of their height.
                    let wall = distance - half_width - 0.2 * (height - bottom).max(0.0);
                    density.min(wall.max(bottom - height))
                });
                self.occupied.push((point.x, point.z, half_width));
            }
            ravines.push(Ravine { path, width: 2.0 * half_width });
        }
        ravines
    }

    fn plateaus(&mut self, lattice: &mut Lattice) -> Vec<Plateau> {
        let max_top = self.spec.size.height as f32 - 12.0;
        let mut plateaus = Vec::new();
        for _ in 0..self.count(PLATEAU_COUNT, self.spec.features.plateaus) {
            let radius = self.rng.random_range(6.0..13.0);
            let rise = self.rng.random_range(3.0..11.0);
            let Some((x, z)) = self.spot(radius) else { continue };
            let top = (ring_heights(lattice, x, z, radius).0 + rise).max(lattice.top(x, z) + 2.0).min(max_top);
            lattice.edit_column(x, z, radius + 2.0 * VOXEL_M, |distance, height, density| {
                // The signed distance to the surface of a cylinder, negative outside.
                density.max((top - height).min(radius - distance))
            });
            self.occupied.push((x, z, radius));
            plateaus.push(Plateau { top: Vec3::new(x, top, z), radius });
        }
        plateaus
    }

    fn pools(&mut self, lattice: &mut Lattice) -> Vec<Pool> {
        let mut pools = Vec::new();
        let wanted = [
            (Liquid::Water, self.count(WATER_COUNT, self.spec.features.water)),
            (Liquid::Lava, self.count(LAVA_COUNT, self.spec.features.lava)),
        ];
        for (liquid, count) in wanted {
            for _ in 0..count {
                let radius = self.rng.random_range(5.0..10.0);
                // Only fairly level ground holds a pool; up to eight sites are tried.
                let site = (0..8).find_map(|_| {
                    let (x, z) = self.spot(radius + 2.0)?;
                    let (low, high) = ring_heights(lattice, x, z, radius + 1.0);
                    (high - low < 2.5).then_some((x, z, low))
                });
                let Some((x, z, rim)) = site else { continue };
                let level = (rim - 0.35).max(2.2);
                let depth = 1.5;
                lattice.edit_column(x, z, radius, |distance, height, density| {
                    let share = distance / radius;
                    let bowl = level - depth * (1.0 - share * share) + 0.4 * share;
                    density.min(bowl - height).max(0.6 - height)
                });
                self.occupied.push((x, z, radius + 1.0));
                pools.push(Pool { centre: Vec3::new(x, level, z), outline: Outline::Round { radius }, depth, liquid });
            }
        }
        pools
    }

    /// Places houses on levelled ground, and solid blocks anywhere.
    fn buildings(&mut self, lattice: &mut Lattice) -> Vec<Building> {
        let max_roof = self.spec.size.height as f32 - 12.0;
        let mut buildings = Vec::new();
        for _ in 0..self.count(BUILDING_COUNT, self.spec.features.buildings) {
            let is_house = self.rng.random_bool(0.6);
            let yaw = self.rng.random_range(0.0..TAU);
            let storeys = if is_house { self.rng.random_range(1..=3u8) } else { 0 };
            let roof_stairs = self.rng.random_bool(0.5);
            let half = if is_house {
                MIN_HOUSE_HALF.map(|least| self.rng.random_range(least..least + 2.0))
            } else {
                [(); 2].map(|()| self.rng.random_range(2.5..5.5f32))
            };
            let rise = match (is_house, self.rng.random_bool(0.6)) {
                (true, _) => f32::from(storeys) * STOREY_M,
                (false, true) => self.rng.random_range(2.6..4.2),
                (false, false) => self.rng.random_range(6.0..12.0),
            };
            let radius = hypot(half[0], half[1]);
            // Houses need ground that can be levelled; up to six sites are tried.
            let site = (0..6).find_map(|_| {
                let (x, z) = self.spot(radius)?;
                let (low, high) = ring_heights(lattice, x, z, radius);
                (!is_house || high - low < 6.0).then_some((x, z, low, high))
            });
            let Some((x, z, low, high)) = site else { continue };
            let floor = if is_house { 0.5 * (low + high) } else { low };
            let top = if is_house { floor + rise } else { (0.5 * (low + high) + rise).max(lattice.top(x, z) + 1.0) };
            if top > max_roof || floor < 5.0 {
                continue;
            }
            let base = Vec3::new(x, floor, z);
            let building = Building { base, half, yaw, height: top - floor, storeys, roof_stairs };
            if is_house {
                level_ground(lattice, &building);
            }
            self.occupied.push((x, z, radius));
            buildings.push(building);
        }
        buildings
    }

    /// Places straight tunnels through rock, each between two places on the surface with a hill in between.
    fn caves(&mut self, lattice: &mut Lattice) -> Vec<Cave> {
        let mut caves = Vec::new();
        for _ in 0..self.count(CAVE_COUNT, self.spec.features.caves) {
            let radius = self.rng.random_range(2.4..3.2f32);
            let site = (0..60).find_map(|_| {
                let (x, z) = self.spot(radius)?;
                let (sin, cos) = libm::sincosf(self.rng.random_range(0.0..TAU));
                let length = self.rng.random_range(24.0..60.0f32);
                let from = Vec3::new(x, lattice.top(x, z), z);
                let (far_x, far_z) = (x + sin * length, z + cos * length);
                let inside = |value: f32, side: u32| value > RIM_M && value < side as f32 - RIM_M;
                if !inside(far_x, self.spec.size.width) || !inside(far_z, self.spec.size.depth) {
                    return None;
                }
                let to = Vec3::new(far_x, lattice.top(far_x, far_z), far_z);
                let is_gentle = (to.y - from.y).abs() < 0.4 * length && from.y.min(to.y) > 6.0;
                let clear = (0..=8).all(|i| {
                    let point = from + (to - from) * (i as f32 / 8.0);
                    self.is_free(point.x, point.z, radius)
                });
                let covered = (2..=6).filter(|&i| {
                    let point = from + (to - from) * (i as f32 / 8.0);
                    lattice.top(point.x, point.z) > point.y + 2.0 * radius + 1.5
                });
                (is_gentle && clear && covered.count() >= 3).then_some((from, to))
            });
            let Some((from, to)) = site else { continue };
            carve_tunnel(lattice, from, to, radius);
            self.occupied.push((from.x, from.z, radius));
            self.occupied.push((to.x, to.z, radius));
            caves.push(Cave { from, to, radius });
        }
        caves
    }

    fn pads(&mut self, lattice: &Lattice, placed: &Placed) -> Vec<Pad> {
        let density = self.spec.features.pads;
        let mut pads = Vec::new();
        if density > 0.0 {
            let plateaus = placed.plateaus.iter().map(|plateau| (plateau.top, plateau.radius));
            let roofs = placed.buildings.iter().filter(|building| building.storeys == 0 || !building.roof_stairs);
            for (top, radius) in plateaus.chain(roofs.map(|building| (building.roof(), building.radius()))) {
                pads.extend(self.pad_beside(lattice, top, radius));
            }
        }
        for _ in 0..self.count(CLIFF_PAD_COUNT, density) {
            pads.extend(self.pad_below_cliff(lattice));
        }
        for _ in 0..self.count(PAD_COUNT, density) {
            let Some((x, z)) = self.spot(DISC_RADIUS_M) else { continue };
            if is_in_pool(&placed.pools, x, z) {
                continue;
            }
            let rise = self.rng.random_range(0.0..8.0);
            self.occupied.push((x, z, DISC_RADIUS_M));
            pads.push(pad(Vec3::new(x, lattice.top(x, z), z), rise));
        }
        pads
    }

    /// Places a pad where nearby terrain rises higher than a character can jump.
    fn pad_below_cliff(&mut self, lattice: &Lattice) -> Option<Pad> {
        for _ in 0..24 {
            let (x, z) = self.spot(DISC_RADIUS_M)?;
            let ground = lattice.top(x, z);
            let (low, high) = ring_heights(lattice, x, z, DISC_RADIUS_M);
            let rise = ring_heights(lattice, x, z, 7.0).1 - ground;
            if (JUMPABLE_M..14.0).contains(&rise) && high - low < 0.8 {
                self.occupied.push((x, z, DISC_RADIUS_M));
                return Some(pad(Vec3::new(x, ground, z), rise - PAD_EXTRA_M + 4.0));
            }
        }
        None
    }

    /// Places a pad at the foot of a plateau or building that is too tall to jump onto from the pad's ground.
    fn pad_beside(&mut self, lattice: &Lattice, top: Vec3, radius: f32) -> Option<Pad> {
        for _ in 0..16 {
            let (sin, cos) = libm::sincosf(self.rng.random_range(0.0..TAU));
            let reach = radius + 2.5;
            let (x, z) = (top.x + cos * reach, top.z + sin * reach);
            let inside = |value: f32, side: u32| value > 4.0 && value < side as f32 - 4.0;
            if !inside(x, self.spec.size.width) || !inside(z, self.spec.size.depth) {
                continue;
            }
            let ground = lattice.top(x, z);
            let (low, high) = ring_heights(lattice, x, z, DISC_RADIUS_M);
            let rise = top.y - ground;
            if rise > JUMPABLE_M && high - low < 1.0 && self.is_free(x, z, DISC_RADIUS_M - 1.0) {
                self.occupied.push((x, z, DISC_RADIUS_M));
                return Some(pad(Vec3::new(x, ground, z), rise - PAD_EXTRA_M + 4.0));
            }
        }
        None
    }

    fn jetpacks(&mut self, lattice: &Lattice, placed: &Placed) -> Vec<Jetpack> {
        let mut jetpacks = Vec::new();
        for _ in 0..self.count(JETPACK_COUNT, self.spec.features.jetpacks) {
            let Some((x, z)) = self.spot(DISC_RADIUS_M) else { continue };
            let (low, high) = ring_heights(lattice, x, z, DISC_RADIUS_M);
            if high - low < 1.0 && !is_in_pool(&placed.pools, x, z) {
                self.occupied.push((x, z, DISC_RADIUS_M));
                jetpacks.push(Jetpack { centre: Vec3::new(x, lattice.top(x, z), z), fuel: JETPACK_FUEL_S });
            }
        }
        jetpacks
    }
}

fn is_in_pool(pools: &[Pool], x: f32, z: f32) -> bool {
    pools.iter().any(|pool| {
        let reach = pool.outline.half_extents().0 + 2.0;
        hypot(pool.centre.x - x, pool.centre.z - z) < reach
    })
}

/// Lowest and highest top of the terrain on a circle, m.
fn ring_heights(lattice: &Lattice, x: f32, z: f32, radius: f32) -> (f32, f32) {
    (0..12)
        .map(|i| {
            let (sin, cos) = libm::sincosf(i as f32 * TAU / 12.0);
            lattice.top(x + cos * radius, z + sin * radius)
        })
        .fold((f32::INFINITY, f32::NEG_INFINITY), |(low, high), top| (low.min(top), high.max(top)))
}

/// Levels the ground in and around a house to just below its floor, and blends it into the terrain further out.
fn level_ground(lattice: &mut Lattice, building: &Building) {
    const APRON_M: f32 = 2.5;
    const BLEND_M: f32 = 4.0;
    let reach = building.radius() + APRON_M + BLEND_M;
    let level = building.base.y - 0.04;
    let (sin, cos) = libm::sincosf(building.yaw);
    let low = Vec3::new(building.base.x - reach, 0.0, building.base.z - reach);
    let high = Vec3::new(building.base.x + reach, f32::MAX, building.base.z + reach);
    let [hx, hz] = building.half;
    lattice.edit_box(low, high, |point, density| {
        let (dx, dz) = (point.x - building.base.x, point.z - building.base.z);
        let (u, v) = ((dx * cos - dz * sin).abs() - hx, (dx * sin + dz * cos).abs() - hz);
        let outside = hypot(u.max(0.0), v.max(0.0));
        let share = (1.0 - (outside - APRON_M) / BLEND_M).clamp(0.0, 1.0);
        let levelled = level - point.y;
        density + (levelled - density) * share
    });
}

/// Carves a tunnel between two places on the surface, with a floor that is level across, and clears the mouths.
fn carve_tunnel(lattice: &mut Lattice, from: Vec3, to: Vec3, radius: f32) {
    let reach = Vec3::splat(radius + 2.0 * VOXEL_M);
    let axis = to - from;
    let run_squared = axis.x * axis.x + axis.z * axis.z;
    let low = from.min(to) - reach;
    let high = from.max(to) + reach + Vec3::new(0.0, 2.0 * radius, 0.0);
    lattice.edit_box(low, high, |point, density| {
        let offset = point - from;
        let t = ((offset.x * axis.x + offset.z * axis.z) / run_squared).clamp(-0.02, 1.02);
        let floor = from.y + axis.y * t;
        let (dx, dz) = (offset.x - axis.x * t, offset.z - axis.z * t);
        let aside = hypot(dx, dz);
        let above = point.y - floor;
        // Positive outside the tunnel: a round vault over a floor.
        let vault = hypot(aside, (above - 0.6 * radius).max(0.0)) - radius;
        density.min(vault.max(-above))
    });
}
