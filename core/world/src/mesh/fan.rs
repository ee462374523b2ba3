//! Casts a cone of rays, the rays of one azimuth together.
//!
//! One walk over the columns serves eight elevations. Each step compares the heights of eight rays with the column, and
//! intersects each ray that touches the column with eight triangles at once.

use super::columns::{Block, Column, Columns, SLACK_M};
use super::lanes::{LANES, Lanes, Portable};
use super::triangle::{SEAM_SLACK, Surface};
use crate::Vec3;

/// Horizontal component below which a ray never leaves its column along an axis.
const PARALLEL: f32 = 1.0e-9;
/// Distance to a border that the ray never reaches, m.
const NEVER_M: f32 = 1.0e30;
/// All rays of a fan.
const ALL_RAYS: u32 = (1 << LANES) - 1;
/// Surfaces of a block of ground.
const ONLY_GROUND: [Surface; LANES] = [Surface::Ground; LANES];

/// Hit of a ray of a cone.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ConeHit {
    /// Distance along the ray, m.
    pub distance: f32,
    /// Surface that was hit.
    pub surface: Surface,
}

/// Hits of the rays of a cone, by elevation and azimuth.
pub type ConeHits = [[Option<ConeHit>; LANES]; LANES];

/// The elevations of a cone and the reach of its rays.
#[derive(Debug, Clone)]
pub struct Elevations {
    range: f32,
    sines: [f32; LANES],
    cosines: [f32; LANES],
    tangents: [f32; LANES],
    /// Distance along the ray for each metre over the ground.
    stretch: [f32; LANES],
    /// Horizontal reach of the rays in each set of them, m.
    reaches: [f32; 1 << LANES],
}

impl Elevations {
    /// Elevations in rad, between straight down and straight up; `range` in m.
    ///
    /// # Panics
    /// If a ray would be upright.
    pub fn new(elevations: [f32; LANES], range: f32) -> Self {
        let (sines, cosines) = (elevations.map(libm::sinf), elevations.map(libm::cosf));
        assert!(cosines.iter().all(|&cos| cos > 1.0e-3), "no ray of a cone is upright");
        let mut tangents = sines;
        tangents.iter_mut().zip(cosines).for_each(|(tangent, cos)| *tangent /= cos);
        let mut reaches = [0.0; 1 << LANES];
        for (rays, reach) in reaches.iter_mut().enumerate() {
            let cast = (0..LANES).filter(|lane| rays >> lane & 1 == 1);
            *reach = cast.map(|lane| range * cosines[lane]).fold(0.0, f32::max);
        }
        Self { range, sines, cosines, tangents, stretch: cosines.map(|cos| 1.0 / cos), reaches }
    }

    /// Length of the rays, m.
    pub(super) fn range(&self) -> f32 {
        self.range
    }

    /// Rise and length of a ray per horizontal metre, m.
    pub(crate) fn slope(&self, lane: usize) -> (f32, f32) {
        (self.tangents[lane], self.stretch[lane])
    }

    /// Unit directions of the rays at a heading, a horizontal unit vector (x, z).
    #[inline(always)]
    pub fn directions(&self, heading: (f32, f32)) -> [Vec3; LANES] {
        let mut directions = [Vec3::ZERO; LANES];
        for (lane, direction) in directions.iter_mut().enumerate() {
            let cos = self.cosines[lane];
            *direction = Vec3::new(heading.0 * cos, self.sines[lane], heading.1 * cos);
        }
        directions
    }
}

/// A cone at one place.
#[derive(Clone, Copy)]
struct Cast<'a> {
    columns: &'a Columns,
    elevations: &'a Elevations,
    /// Origin of all rays, m.
    eye: Vec3,
    headings: &'a [(f32, f32); LANES],
}

impl Columns {
    /// Casts the cone and returns the first surface along each ray.
    pub fn cast_cone(&self, elevations: &Elevations, eye: Vec3, headings: &[(f32, f32); LANES]) -> ConeHits {
        let cast = Cast { columns: self, elevations, eye, headings };
        #[cfg(target_arch = "x86_64")]
        if let Some(avx2) = pulp::x86::V3::try_new() {
            return avx2.vectorize(OnAvx2(avx2, cast));
        }
        cast.hits(Portable)
    }
}

#[cfg(target_arch = "x86_64")]
struct OnAvx2<'a>(pulp::x86::V3, Cast<'a>);

#[cfg(target_arch = "x86_64")]
impl pulp::NullaryFnOnce for OnAvx2<'_> {
    type Output = ConeHits;

    #[inline(always)]
    fn call(self) -> ConeHits {
        self.1.hits(self.0)
    }
}

/// State of a fan that crosses the columns. Distances are horizontal, m.
struct Walk<V> {
    /// Distance to the next border across x and z.
    next: (f32, f32),
    /// Distance between borders.
    spacing: (f32, f32),
    /// Next column, counted from the ring, and the step to its neighbours.
    column: (i32, i32),
    step: (i32, i32),
    /// Distance at which the walk enters the next column.
    entry: f32,
    /// Heights of the rays there, in quanta.
    entry_heights: V,
    /// Distance at which the columns end.
    border: f32,
    /// Distance at which the walk ends: the border, or the reach of the open rays.
    end: f32,
    /// Open rays: those that have not hit anything.
    open: u32,
}

/// A column that rays of a fan touch.
struct Touched<V> {
    column: Column,
    place: (i32, i32),
    /// Stretch of the walk inside the column.
    from: f32,
    to: f32,
    rays: u32,
    /// Least and greatest height of each ray on that stretch, in quanta.
    lowest: V,
    highest: V,
}

impl Cast<'_> {
    #[inline(always)]
    fn hits<L: Lanes>(self, lanes: L) -> ConeHits {
        let mut hits = [[None; LANES]; LANES];
        for azimuth in 0..LANES {
            self.cast_fan(lanes, azimuth, ALL_RAYS, &mut hits);
        }
        hits
    }

    /// Casts some rays of one azimuth.
    #[inline(always)]
    fn cast_fan<L: Lanes>(self, lanes: L, azimuth: usize, rays: u32, hits: &mut ConeHits) {
        let heading = self.headings[azimuth];
        let Some(mut walk) = self.begin(lanes, heading, rays) else { return };
        let directions = self.elevations.directions(heading);
        while let Some(touched) = self.advance(lanes, &mut walk) {
            let hit = self.test(lanes, &directions, &touched, azimuth, hits);
            if hit != 0 {
                walk.open &= !hit;
                walk.end = self.elevations.reaches[walk.open as usize].min(walk.border);
            }
        }
    }

    /// Starts a walk where the rays enter the columns; `None` if the rays miss them.
    #[inline(always)]
    fn begin<L: Lanes>(self, lanes: L, (hx, hz): (f32, f32), rays: u32) -> Option<Walk<L::Values>> {
        let Self { columns, elevations, eye, .. } = self;
        let (x, z) = (eye.x - columns.corner.0, eye.z - columns.corner.1);
        let along_x = Axis::new(x, hx, columns.side, columns.counts.0)?;
        let along_z = Axis::new(z, hz, columns.side, columns.counts.1)?;
        let entry = along_x.enter.max(along_z.enter);
        let border = along_x.leave.min(along_z.leave);
        if entry > border {
            return None;
        }
        let (column_x, next_x) = along_x.first_column(entry);
        let (column_z, next_z) = along_z.first_column(entry);
        let height = (eye.y - columns.floor) * columns.quanta_per_m;
        let rise = lanes.mul(self.tangents(lanes), lanes.splat(entry));
        Some(Walk {
            next: (next_x, next_z),
            spacing: (along_x.spacing, along_z.spacing),
            column: (column_x + 1, column_z + 1),
            step: (along_x.step, along_z.step),
            entry,
            entry_heights: lanes.add(lanes.splat(height), rise),
            border,
            end: elevations.reaches[rays as usize].min(border),
            open: rays,
        })
    }

    /// Rise of each ray per horizontal metre, in quanta.
    #[inline(always)]
    fn tangents<L: Lanes>(self, lanes: L) -> L::Values {
        lanes.mul(lanes.load(&self.elevations.tangents), lanes.splat(self.columns.quanta_per_m))
    }

    /// Advances to the next column that an open ray touches.
    #[inline(always)]
    fn advance<L: Lanes>(self, lanes: L, walk: &mut Walk<L::Values>) -> Option<Touched<L::Values>> {
        let height = lanes.splat((self.eye.y - self.columns.floor) * self.columns.quanta_per_m);
        let tangents = self.tangents(lanes);
        let Walk { mut next, spacing, column: mut place, step, mut entry, mut entry_heights, end, open, .. } = *walk;
        while entry < end {
            let column = self.columns.at(place)?;
            let across_x = next.0 < next.1;
            let exit = if across_x { next.0 } else { next.1 };
            let exit_heights = lanes.add(height, lanes.mul(tangents, lanes.splat(exit)));
            let highest = lanes.max(entry_heights, exit_heights);
            let lowest = lanes.min(entry_heights, exit_heights);
            let above = lanes.at_most(lanes.splat(f32::from(column.low)), highest);
            let below = lanes.at_most(lowest, lanes.splat(f32::from(column.high)));
            let rays = lanes.bits(lanes.both(above, below)) & open;
            let touched = Touched { column, place, from: entry, to: exit, rays, lowest, highest };
            (entry, entry_heights) = (exit, exit_heights);
            next.0 += if across_x { spacing.0 } else { 0.0 };
            next.1 += if across_x { 0.0 } else { spacing.1 };
            place.0 += if across_x { step.0 } else { 0 };
            place.1 += if across_x { 0 } else { step.1 };
            if rays != 0 {
                (walk.next, walk.column, walk.entry, walk.entry_heights) = (next, place, entry, entry_heights);
                return Some(touched);
            }
        }
        None
    }

    /// Intersects rays with the triangles of a column, notes hits, and returns the rays that hit something.
    #[inline(always)]
    fn test<L: Lanes>(
        self,
        lanes: L,
        directions: &[Vec3; LANES],
        touched: &Touched<L::Values>,
        azimuth: usize,
        hits: &mut ConeHits,
    ) -> u32 {
        let columns = self.columns;
        let column = touched.column;
        let eye = self.eye - columns.base(touched.place, column.low);
        let mut found = Nearest::new(self.elevations, touched.from, touched.to);
        for idx in column.first_block().. {
            let Some(block) = columns.blocks.get(idx) else { break };
            let (rays, is_last) = self.rays_at(lanes, touched, idx);
            if rays != 0 {
                let block = PreparedBlock::new(lanes, block, eye);
                let surfaces = if column.is_only_ground() { &ONLY_GROUND } else { &columns.surfaces[idx] };
                for ray in set_bits(rays) {
                    let (triangles, distances) =
                        block.intersect(lanes, directions[ray], found.near[ray], found.far[ray]);
                    if triangles != 0 {
                        found.note(ray, triangles, &lanes.store(distances), surfaces);
                    }
                }
            }
            if is_last {
                break;
            }
        }
        for ray in set_bits(found.hit) {
            hits[ray][azimuth % LANES] = Some(ConeHit { distance: found.far[ray], surface: found.surfaces[ray] });
        }
        found.hit
    }

    /// The open rays that pass at the height of a block, and whether the block is the last of its column.
    #[inline(always)]
    fn rays_at<L: Lanes>(self, lanes: L, touched: &Touched<L::Values>, block: usize) -> (u32, bool) {
        if touched.column.is_single() {
            return (touched.rays, true);
        }
        let span = self.columns.spans[block];
        let above = lanes.at_most(lanes.splat(f32::from(span.low)), touched.highest);
        let below = lanes.at_most(touched.lowest, lanes.splat(f32::from(span.high)));
        (touched.rays & lanes.bits(lanes.both(above, below)), span.is_last)
    }
}

/// Indices of the bits that are set, ascending.
#[inline(always)]
fn set_bits(mut bits: u32) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        let idx = bits.trailing_zeros() as usize;
        (bits != 0).then(|| {
            bits &= bits - 1;
            idx % LANES
        })
    })
}

/// The nearest hits of the rays in a column.
struct Nearest {
    /// Stretch of each ray inside the column, m; a hit shortens it.
    near: [f32; LANES],
    far: [f32; LANES],
    surfaces: [Surface; LANES],
    /// Rays that hit something.
    hit: u32,
}

impl Nearest {
    #[inline(always)]
    fn new(elevations: &Elevations, from: f32, to: f32) -> Self {
        let (mut near, mut far) = ([0.0f32; LANES], [0.0f32; LANES]);
        for lane in 0..LANES {
            let stretch = elevations.stretch[lane];
            let (from, to) = (from * stretch - SLACK_M, to * stretch + SLACK_M);
            near[lane] = if from > 0.0 { from } else { 0.0 };
            far[lane] = if to < elevations.range { to } else { elevations.range };
        }
        Self { near, far, surfaces: ONLY_GROUND, hit: 0 }
    }

    /// Notes the nearest of these triangles of a block; of several at the same distance, the first one counts.
    #[inline(always)]
    fn note(&mut self, ray: usize, triangles: u32, distances: &[f32; LANES], surfaces: &[Surface; LANES]) {
        for triangle in set_bits(triangles) {
            if self.hit >> ray & 1 == 0 || distances[triangle] < self.far[ray] {
                self.hit |= 1 << ray;
                self.far[ray] = distances[triangle];
                self.surfaces[ray] = surfaces[triangle];
            }
        }
    }
}

/// A block, seen from the eye.
struct PreparedBlock<V> {
    /// The rows without their offsets.
    rows: [V; 9],
    /// Distance of the eye from each plane, negated, and its barycentric coordinates.
    plane: V,
    u: V,
    v: V,
}

impl<V: Copy> PreparedBlock<V> {
    /// `eye` is relative to the base of the column, m.
    #[inline(always)]
    fn new<L: Lanes<Values = V>>(lanes: L, block: &Block, eye: Vec3) -> Self {
        let row = |idx: usize| lanes.load(&block.rows[idx]);
        let (x, y, z) = (lanes.splat(eye.x), lanes.splat(eye.y), lanes.splat(eye.z));
        let at = |idx: usize| {
            let across = lanes.add(lanes.mul(row(idx), x), lanes.mul(row(idx + 1), y));
            lanes.add(across, lanes.add(lanes.mul(row(idx + 2), z), row(idx + 3)))
        };
        Self {
            rows: [row(0), row(1), row(2), row(4), row(5), row(6), row(8), row(9), row(10)],
            plane: lanes.mul(at(0), lanes.splat(-1.0)),
            u: at(4),
            v: at(8),
        }
    }

    /// The triangles that a ray hits between `near` and `far`, and the distances to all planes.
    #[inline(always)]
    fn intersect<L: Lanes<Values = V>>(&self, lanes: L, direction: Vec3, near: f32, far: f32) -> (u32, V) {
        let (x, y, z) = (lanes.splat(direction.x), lanes.splat(direction.y), lanes.splat(direction.z));
        let along = |idx: usize| {
            let across = lanes.add(lanes.mul(self.rows[idx], x), lanes.mul(self.rows[idx + 1], y));
            lanes.add(across, lanes.mul(self.rows[idx + 2], z))
        };
        let distance = lanes.div(self.plane, along(0));
        let u = lanes.add(self.u, lanes.mul(distance, along(3)));
        let v = lanes.add(self.v, lanes.mul(distance, along(6)));
        let on_ray = lanes.both(lanes.at_most(lanes.splat(near), distance), lanes.at_most(distance, lanes.splat(far)));
        let inside = lanes.both(
            lanes.at_most(lanes.splat(-SEAM_SLACK), lanes.min(u, v)),
            lanes.at_most(lanes.add(u, v), lanes.splat(1.0 + SEAM_SLACK)),
        );
        (lanes.bits(lanes.both(on_ray, inside)), distance)
    }
}

/// A walk along one axis.
struct Axis {
    /// Coordinate of the eye, m from the corner.
    from: f32,
    /// Component of the heading, and its inverse.
    heading: f32,
    inverse: f32,
    side: f32,
    count: i32,
    /// Where the ray enters and leaves the columns, m.
    enter: f32,
    leave: f32,
    spacing: f32,
    step: i32,
}

impl Axis {
    /// `None` if a parallel ray is beside the columns.
    #[inline(always)]
    fn new(from: f32, heading: f32, side: f32, count: i32) -> Option<Self> {
        let length = count as f32 * side;
        let inverse = 1.0 / heading;
        let step = if heading > 0.0 { 1 } else { -1 };
        let (enter, leave, spacing) = if heading.abs() > PARALLEL {
            let (low, high) = (-from * inverse, (length - from) * inverse);
            let (enter, leave) = if heading > 0.0 { (low, high) } else { (high, low) };
            (if enter > 0.0 { enter } else { 0.0 }, leave, side * inverse.abs())
        } else if (0.0..=length).contains(&from) {
            (0.0, NEVER_M, NEVER_M)
        } else {
            return None;
        };
        Some(Self { from, heading, inverse, side, count, enter, leave, spacing, step })
    }

    /// The column at distance `entry`, and the distance to the border where the ray leaves it.
    #[inline(always)]
    fn first_column(&self, entry: f32) -> (i32, f32) {
        let column = (((self.from + self.heading * entry) / self.side) as i32).clamp(0, self.count - 1);
        let next = if self.heading.abs() <= PARALLEL {
            NEVER_M
        } else {
            ((column + i32::from(self.step > 0)) as f32 * self.side - self.from) * self.inverse
        };
        (column, next)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::triangle::Triangle;
    use rand::rngs::ChaCha8Rng;
    use rand::{RngExt, SeedableRng};
    use std::f32::consts::PI;

    #[test]
    fn every_path_gives_the_same_bits() {
        let mut rng = ChaCha8Rng::seed_from_u64(3);
        let mut height = || rng.random_range(0.0..30.0f32);
        let heights: [[f32; 51]; 51] = std::array::from_fn(|_| std::array::from_fn(|_| height()));
        let corner = |x: usize, z: usize| Vec3::new(2.0 * x as f32, heights[x][z], 2.0 * z as f32);
        let quads = (0..50).flat_map(|x| (0..50).map(move |z| (x, z)));
        let triangles: Vec<Triangle> = quads
            .flat_map(|(x, z)| {
                let [a, b, c, d] = [corner(x, z), corner(x, z + 1), corner(x + 1, z + 1), corner(x + 1, z)];
                [Triangle::new([a, b, c], Surface::Ground), Triangle::new([a, c, d], Surface::Water)]
            })
            .flatten()
            .collect();
        let columns = &Columns::new(&triangles);
        let elevations =
            Elevations::new([-65.0f32, -42.0, -26.0, -14.0, -5.0, 6.0, 22.0, 45.0].map(f32::to_radians), 30.0);
        let mut hit_count = 0;
        for _ in 0..2000 {
            let eye =
                Vec3::new(rng.random_range(-9.0..109.0), rng.random_range(0.0..60.0), rng.random_range(-9.0..109.0));
            let headings = std::array::from_fn(|_| libm::sincosf(rng.random_range(-PI..PI)));
            let cast = Cast { columns, elevations: &elevations, eye, headings: &headings };
            let together = cast.hits(Portable);
            let mut alone = [[None; LANES]; LANES];
            for azimuth in 0..LANES {
                (0..LANES).for_each(|ray| cast.cast_fan(Portable, azimuth, 1 << ray, &mut alone));
            }
            assert_eq!(together, alone, "from {eye:?}");
            assert_eq!(together, columns.cast_cone(&elevations, eye, &headings), "from {eye:?}");
            hit_count += together.as_flattened().iter().flatten().count();
        }
        assert!(hit_count > 20_000, "only {hit_count} of 128,000 rays hit something");
    }
}
