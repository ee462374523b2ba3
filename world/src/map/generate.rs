//! From a [`MapSpec`] to a [`Map`]: terrain, then plateaus, pools, buildings and pads, each its own phase.

use super::terrain::{Lattice, VOXEL_M};
use super::{Building, Liquid, Map, MapSpec, PAD_RADIUS_M, Pad, Plateau, Pool, SpecError};
use crate::Vec3;
use crate::mesh::{Mesh, Surface, Triangle};
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use std::f32::consts::TAU;

/// Area that the feature counts below are given for: the default map's, m2.
const REFERENCE_AREA_M2: f32 = 62_500.0;
/// Counts of each feature on a default map.
const PLATEAU_COUNT: f32 = 12.0;
const BUILDING_COUNT: f32 = 18.0;
const WATER_COUNT: f32 = 6.0;
const LAVA_COUNT: f32 = 5.0;
const PAD_COUNT: f32 = 4.0;
/// Pads at the foot of cliffs.
const CLIFF_PAD_COUNT: f32 = 20.0;
/// Distance of every feature from the rim of the map, m.
const RIM_M: f32 = 14.0;
/// Rises above this need a pad: a double jump reaches 5 m.
const JUMPABLE_M: f32 = 4.4;
/// Gravity that pad speeds are computed for, m/s2.
const PAD_GRAVITY: f32 = 20.0;
/// Extra height of a pad's throw, m (released environment).
const PAD_EXTRA_M: f32 = 10.0;
/// Triangles around a disc.
const DISC_SIDES: usize = 16;

impl Map {
    /// Generates the map of `spec`.
    ///
    /// # Errors
    /// If a field of the spec is out of range.
    pub fn generate(spec: &MapSpec) -> Result<Self, SpecError> {
        spec.validate()?;
        let mut placer = Placer::new(spec);
        let mut lattice = Lattice::sample(spec.seed, spec.size);
        let plateaus = placer.plateaus(&mut lattice);
        let pools = placer.pools(&mut lattice);
        let buildings = placer.buildings(&lattice);
        let pads = placer.pads(&lattice, &plateaus, &buildings, &pools);
        let mesh = build_mesh(spec, &lattice, &pools, &buildings, &pads);
        Ok(Self::assemble(*spec, mesh, pools, pads, buildings, plateaus))
    }
}

/// Places features so that none stands in another's way.
struct Placer {
    spec: MapSpec,
    rng: ChaCha8Rng,
    /// Discs (x, z, radius) that are taken.
    taken: Vec<(f32, f32, f32)>,
}

impl Placer {
    fn new(spec: &MapSpec) -> Self {
        // A stream of its own, so that terrain and placements do not share random numbers.
        let mut rng = ChaCha8Rng::seed_from_u64(spec.seed);
        rng.set_stream(1);
        Self { spec: *spec, rng, taken: Vec::new() }
    }

    fn count(&self, reference: f32, density: f32) -> usize {
        let area = (self.spec.size.width * self.spec.size.depth) as f32;
        (reference * density * area / REFERENCE_AREA_M2).round() as usize
    }

    /// A free disc of `radius`, or `None` when forty draws found none.
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
        self.taken.iter().all(|&(tx, tz, taken_radius)| {
            let (dx, dz, gap) = (x - tx, z - tz, radius + taken_radius + 1.0);
            dx * dx + dz * dz > gap * gap
        })
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
                // The distance to a cylinder's surface, negative outside.
                density.max((top - height).min(radius - distance))
            });
            self.taken.push((x, z, radius));
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
                // Only fairly level ground holds a pool; eight draws are given to find some.
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
                self.taken.push((x, z, radius + 1.0));
                pools.push(Pool { centre: Vec3::new(x, level, z), radius, depth, liquid });
            }
        }
        pools
    }

    fn buildings(&mut self, lattice: &Lattice) -> Vec<Building> {
        let max_roof = self.spec.size.height as f32 - 12.0;
        let mut buildings = Vec::new();
        for _ in 0..self.count(BUILDING_COUNT, self.spec.features.buildings) {
            let half_x = self.rng.random_range(2.5..6.0f32);
            let half_z = self.rng.random_range(2.5..6.0f32);
            let rise = if self.rng.random_bool(0.6) {
                self.rng.random_range(2.6..4.2)
            } else {
                self.rng.random_range(6.0..12.0)
            };
            let radius = (half_x * half_x + half_z * half_z).sqrt();
            let Some((x, z)) = self.spot(radius) else { continue };
            let (low, high) = ring_heights(lattice, x, z, radius);
            let roof = (0.5 * (low + high) + rise).max(lattice.top(x, z) + 1.0).min(max_roof);
            self.taken.push((x, z, radius));
            buildings.push(Building {
                min: Vec3::new(x - half_x, (low - 3.0).max(0.2), z - half_z),
                max: Vec3::new(x + half_x, roof, z + half_z),
            });
        }
        buildings
    }

    fn pads(&mut self, lattice: &Lattice, plateaus: &[Plateau], buildings: &[Building], pools: &[Pool]) -> Vec<Pad> {
        let mut pads = Vec::new();
        let tall =
            plateaus.iter().map(|plateau| (plateau.top, plateau.radius)).chain(buildings.iter().map(|building| {
                let half = (building.max - building.min) * 0.5;
                let centre = (building.max + building.min) * 0.5;
                (Vec3::new(centre.x, building.max.y, centre.z), (half.x * half.x + half.z * half.z).sqrt())
            }));
        for (top, radius) in tall {
            if let Some(pad) = self.pad_beside(lattice, top, radius) {
                pads.push(pad);
            }
        }
        for _ in 0..self.count(CLIFF_PAD_COUNT, self.spec.features.pads) {
            pads.extend(self.pad_below_cliff(lattice));
        }
        for _ in 0..self.count(PAD_COUNT, self.spec.features.pads) {
            let Some((x, z)) = self.spot(PAD_RADIUS_M) else { continue };
            if pools.iter().any(|pool| (pool.centre.x - x).hypot(pool.centre.z - z) < pool.radius + 2.0) {
                continue;
            }
            let rise = self.rng.random_range(0.0..8.0);
            self.taken.push((x, z, PAD_RADIUS_M));
            pads.push(pad(Vec3::new(x, lattice.top(x, z), z), rise));
        }
        pads
    }

    /// A pad where the terrain nearby rises higher than can be jumped.
    fn pad_below_cliff(&mut self, lattice: &Lattice) -> Option<Pad> {
        for _ in 0..24 {
            let (x, z) = self.spot(PAD_RADIUS_M)?;
            let ground = lattice.top(x, z);
            let (low, high) = ring_heights(lattice, x, z, PAD_RADIUS_M);
            let rise = ring_heights(lattice, x, z, 7.0).1 - ground;
            if (JUMPABLE_M..14.0).contains(&rise) && high - low < 0.8 {
                self.taken.push((x, z, PAD_RADIUS_M));
                return Some(pad(Vec3::new(x, ground, z), rise - PAD_EXTRA_M + 4.0));
            }
        }
        None
    }

    /// A pad at the foot of something too tall to be jumped onto from the pad's own ground.
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
            let (low, high) = ring_heights(lattice, x, z, PAD_RADIUS_M);
            let rise = top.y - ground;
            if rise > JUMPABLE_M && high - low < 1.0 && self.is_free(x, z, PAD_RADIUS_M - 1.0) {
                self.taken.push((x, z, PAD_RADIUS_M));
                return Some(pad(Vec3::new(x, ground, z), rise - PAD_EXTRA_M + 4.0));
            }
        }
        None
    }
}

/// A pad that throws 10 m higher than `rise`: `v = sqrt(2 g (rise + 10))`.
fn pad(centre: Vec3, rise: f32) -> Pad {
    Pad { centre, speed: (2.0 * PAD_GRAVITY * (rise.max(-4.0) + PAD_EXTRA_M)).sqrt() }
}

/// Lowest and highest top of the terrain on a circle.
fn ring_heights(lattice: &Lattice, x: f32, z: f32, radius: f32) -> (f32, f32) {
    (0..12)
        .map(|i| {
            let (sin, cos) = libm::sincosf(i as f32 * TAU / 12.0);
            lattice.top(x + cos * radius, z + sin * radius)
        })
        .fold((f32::INFINITY, f32::NEG_INFINITY), |(low, high), top| (low.min(top), high.max(top)))
}

fn build_mesh(spec: &MapSpec, lattice: &Lattice, pools: &[Pool], buildings: &[Building], pads: &[Pad]) -> Mesh {
    let mut triangles: Vec<Triangle> =
        lattice.surface().into_iter().filter_map(|corners| Triangle::new(corners, Surface::Ground)).collect();
    let mut add = |corners: [Vec3; 3], surface: Surface| triangles.extend(Triangle::new(corners, surface));
    for building in buildings {
        for corners in box_triangles(building.min, building.max) {
            add(corners, Surface::Ground);
        }
    }
    for pool in pools {
        for corners in disc_triangles(pool.centre, pool.radius) {
            add(corners, pool.liquid.into());
        }
    }
    for pad in pads {
        for corners in disc_triangles(pad.centre + Vec3::new(0.0, 0.12, 0.0), PAD_RADIUS_M) {
            add(corners, Surface::Pad);
        }
    }
    let extent = Vec3::new(spec.size.width as f32, spec.size.height as f32, spec.size.depth as f32);
    Mesh::new(triangles, extent)
}

/// The twelve triangles of a box, facing outwards.
fn box_triangles(min: Vec3, max: Vec3) -> Vec<[Vec3; 3]> {
    let corner = |x: bool, y: bool, z: bool| {
        Vec3::new(if x { max.x } else { min.x }, if y { max.y } else { min.y }, if z { max.z } else { min.z })
    };
    // Each face counter-clockwise seen from outside.
    let faces = [
        [corner(false, true, false), corner(false, true, true), corner(true, true, true), corner(true, true, false)],
        [
            corner(false, false, false),
            corner(true, false, false),
            corner(true, false, true),
            corner(false, false, true),
        ],
        [
            corner(false, false, false),
            corner(false, false, true),
            corner(false, true, true),
            corner(false, true, false),
        ],
        [corner(true, false, false), corner(true, true, false), corner(true, true, true), corner(true, false, true)],
        [
            corner(false, false, false),
            corner(false, true, false),
            corner(true, true, false),
            corner(true, false, false),
        ],
        [corner(false, false, true), corner(true, false, true), corner(true, true, true), corner(false, true, true)],
    ];
    faces.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect()
}

/// A horizontal disc as a fan, facing up.
fn disc_triangles(centre: Vec3, radius: f32) -> Vec<[Vec3; 3]> {
    let rim = |i: usize| {
        let (sin, cos) = libm::sincosf(i as f32 * TAU / DISC_SIDES as f32);
        centre + Vec3::new(sin * radius, 0.0, cos * radius)
    };
    (0..DISC_SIDES).map(|i| [centre, rim(i), rim(i + 1)]).collect()
}
