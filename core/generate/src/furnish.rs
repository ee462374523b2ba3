//! Places movers on generated maps: doors where walls leave a gap, lifts at cliffs, platforms and floors that vanish
//! over gaps, conveyors and crates on level ground.
//!
//! Each kind draws places where a body stands and keeps those that suit it: the space that the mover sweeps must be
//! free.

use crate::stage::count_on;
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use std::f32::consts::{PI, TAU};
use std::ops::Range;
use surefoot_world::character::{CharacterProfile, MoveScratch};
use surefoot_world::float::turned;
use surefoot_world::map::mover::{MAX_MOVERS, cuboid};
use surefoot_world::map::{Device, Map, MapSpec, Mover, MoverKind, MoverStop};
use surefoot_world::mesh::Surface;
use surefoot_world::navigable::{self, DOWN};
use surefoot_world::{StopIdx, Vec3};

/// Number of movers of each kind on the default map at density 1.
const DOOR_COUNT: f32 = 6.0;
const LIFT_COUNT: f32 = 8.0;
const PLATFORM_COUNT: f32 = 6.0;
const FLOOR_COUNT: f32 = 6.0;
const CONVEYOR_COUNT: f32 = 4.0;
const CRATE_COUNT: f32 = 12.0;
/// Places that are looked at for one mover.
const TRIES: usize = 300;
/// Smallest distance between movers, and between movers and devices, m.
const APART_M: f32 = 6.0;
/// Speed of lifts and platforms, m/s, and how long each mover stays at a stop, s.
const SPEED: f32 = 2.5;
const DWELL_S: f32 = 4.0;
/// Half of the side of lifts and platforms, their thickness, and the height above the ground of their top at a stop, m.
const HALF_M: f32 = 1.4;
const THICK_M: f32 = 0.25;
const RAISED_M: f32 = 0.12;
/// Height that is kept free above what bodies stand on, m.
const HEADROOM_M: f32 = 2.4;
/// Rise of a lift, m.
const LIFT_RISE_M: Range<f32> = 3.0..18.0;
/// Widest gap between a lift or platform and the ground beside it, m.
const MAX_GAP_M: f32 = 1.2;
/// Width of a gap that a platform crosses, and one that a floor spans, m.
const FERRY_M: Range<f32> = 6.0..32.0;
const SPAN_M: Range<f32> = 3.0..10.0;
/// Least depth of such a gap, m.
const GAP_DEPTH_M: f32 = 3.0;
/// Width of a passage with a door, its height and its thickness, m.
const DOOR_WIDTH_M: Range<f32> = 1.0..4.5;
const DOOR_HEIGHT_M: f32 = 2.5;
const DOOR_HALF_THICK_M: f32 = 0.08;
/// Half of the width and length of a conveyor, m, and its speed, m/s.
const BELT_HALF_M: [f32; 2] = [1.2, 4.0];
const BELT_SPEED: f32 = 2.0;
/// Side of a crate, m.
const CRATE_M: Range<f32> = 0.7..1.4;
/// Largest difference in height of ground that counts as level, m.
const LEVEL_M: f32 = 0.15;

const HERE: MoverStop = MoverStop { offset: Vec3::ZERO, yaw: 0.0, is_there: true };

/// The movers of a complete map of `spec`.
pub(crate) fn movers(map: &Map, spec: &MapSpec) -> Vec<Mover> {
    // A stream of its own: what a map is like without movers does not depend on them.
    let mut rng = ChaCha8Rng::seed_from_u64(spec.seed);
    rng.set_stream(4);
    let mut furnisher = Furnisher {
        map,
        profile: CharacterProfile::of_paper(),
        rng,
        scratch: MoveScratch::default(),
        taken: map.placed().devices().flat_map(Device::ends).collect(),
        movers: Vec::new(),
    };
    let wanted = &spec.movers;
    let kinds: [(MoverKind, f32, f32, Site<'_>); 6] = [
        (MoverKind::Door, DOOR_COUNT, wanted.doors, Furnisher::door),
        (MoverKind::Lift, LIFT_COUNT, wanted.lifts, Furnisher::lift),
        (MoverKind::Platform, PLATFORM_COUNT, wanted.platforms, Furnisher::platform),
        (MoverKind::Floor, FLOOR_COUNT, wanted.floors, Furnisher::floor),
        (MoverKind::Conveyor, CONVEYOR_COUNT, wanted.conveyors, Furnisher::conveyor),
        (MoverKind::Crate, CRATE_COUNT, wanted.crates, Furnisher::crate_),
    ];
    for (kind, reference, density, site) in kinds {
        let count = count_on(spec, reference, density).min(MAX_MOVERS / kinds.len());
        for number in 0..count {
            furnisher.place(format!("{}_{number}", kind.name()), site);
        }
    }
    furnisher.movers
}

/// Makes a mover beside a place where a body stands, if the place suits it.
type Site<'a> = fn(&mut Furnisher<'a>, Vec3) -> Option<Mover>;

struct Furnisher<'a> {
    map: &'a Map,
    profile: CharacterProfile,
    rng: ChaCha8Rng,
    scratch: MoveScratch,
    /// What movers keep apart from, m.
    taken: Vec<Vec3>,
    movers: Vec<Mover>,
}

impl<'a> Furnisher<'a> {
    fn place(&mut self, name: String, site: Site<'a>) {
        for _ in 0..TRIES {
            let taken = &self.taken;
            let is_apart = |point: Vec3| taken.iter().all(|it| it.distance_squared(point) > APART_M * APART_M);
            let drawn = navigable::sample_where(self.map, &self.profile, &mut self.rng, &mut self.scratch, is_apart);
            let Ok(feet) = drawn else { return };
            let Some(mover) = feet.and_then(|feet| site(self, feet)) else { continue };
            self.taken.extend((0..mover.stops.len()).map(|stop| {
                let (low, high) = mover.bounds_at(stop);
                (low + high) * 0.5
            }));
            self.movers.push(Mover { name, ..mover });
            return;
        }
    }

    /// A leaf in the narrowest gap around a place, which slides up and down.
    fn door(&mut self, feet: Vec3) -> Option<Mover> {
        let chest = feet + Vec3::Y * 1.1;
        let gap = |turn: u8| {
            let yaw = f32::from(turn) * PI / 16.0;
            let along = turned(Vec3::X, libm::sincosf(yaw));
            let (left, right) =
                (self.wall(chest, -along, DOOR_WIDTH_M.end)?, self.wall(chest, along, DOOR_WIDTH_M.end)?);
            Some((left + right, yaw, left, right))
        };
        let narrowest = (0..16).filter_map(gap).min_by(|a, b| a.0.total_cmp(&b.0))?;
        let (width, yaw, left, right) = narrowest;
        let through = turned(Vec3::Z, libm::sincosf(yaw));
        let leads_on = [through, -through].iter().all(|ahead| self.wall(chest, *ahead, 2.5).is_none());
        // Beside a wall of the same width there is no passage.
        let ends = [through, -through].iter().all(|ahead| {
            let beside = chest + *ahead * 3.0;
            let across = turned(Vec3::X, libm::sincosf(yaw));
            self.wall(beside, across, width).is_none() || self.wall(beside, -across, width).is_none()
        });
        if !DOOR_WIDTH_M.contains(&width) || !leads_on || !ends {
            return None;
        }
        let low = Vec3::new(-left - 0.05, 0.0, -DOOR_HALF_THICK_M);
        let high = Vec3::new(right + 0.05, DOOR_HEIGHT_M, DOOR_HALF_THICK_M);
        let open = MoverStop { offset: Vec3::Y * (DOOR_HEIGHT_M + 0.1), ..HERE };
        let mut door = mover(MoverKind::Door, feet, (low, high), yaw, vec![HERE, open]);
        (door.start, door.travel_s, door.dwell_s) = (StopIdx(1), 1.5, DWELL_S + self.rng.random_range(0.0..4.0f32));
        Some(door)
    }

    /// Distance of a wall within `most` metres.
    fn wall(&self, from: Vec3, direction: Vec3, most: f32) -> Option<f32> {
        // A hair off level, so that no ray runs exactly along an edge.
        let direction = (direction + Vec3::Y * 0.000_37).normalize();
        let hit = self.map.mesh().cast_ray(from, direction, most)?;
        (hit.surface == Surface::Ground).then_some(hit.distance)
    }

    /// A lift beside ground that is higher.
    fn lift(&mut self, feet: Vec3) -> Option<Mover> {
        let mover = self.sides().into_iter().find_map(|ahead| self.lift_towards(feet, ahead))?;
        Some(self.ridden(mover))
    }

    fn lift_towards(&self, feet: Vec3, ahead: Vec3) -> Option<Mover> {
        let beside = (0..4).map(|step| HALF_M + 0.2 + MAX_GAP_M * step as f32 / 3.0);
        let top = beside
            .filter_map(|far| self.ground(feet + ahead * far, feet.y + LIFT_RISE_M.start..feet.y + LIFT_RISE_M.end));
        let top = top.min_by(f32::total_cmp)?;
        // There must be room to step off.
        self.ground(feet + ahead * (HALF_M + MAX_GAP_M + 1.5), top - 0.6..top + 0.6)?;
        let slab = Vec3::new(HALF_M, 0.0, HALF_M);
        let reach = Vec3::Y * (top - feet.y + HEADROOM_M);
        if !self.is_free(feet - slab + Vec3::Y * 0.35, feet + slab + reach) {
            return None;
        }
        let (low, high) = (-slab + Vec3::Y * (RAISED_M - THICK_M), slab + Vec3::Y * RAISED_M);
        let above = MoverStop { offset: Vec3::Y * (top - feet.y), ..HERE };
        Some(mover(MoverKind::Lift, feet, (low, high), 0.0, vec![HERE, above]))
    }

    /// A platform that goes to and fro over a gap.
    fn platform(&mut self, feet: Vec3) -> Option<Mover> {
        let mover = self.sides().into_iter().find_map(|ahead| self.platform_towards(feet, ahead))?;
        Some(self.ridden(mover))
    }

    fn platform_towards(&self, feet: Vec3, ahead: Vec3) -> Option<Mover> {
        let (near, far) = self.banks(feet, ahead, FERRY_M)?;
        let slab = Vec3::new(HALF_M, 0.0, HALF_M);
        let middle = |bank: f32, inwards: f32| feet + ahead * (bank + inwards * (HALF_M + 0.15));
        let (from, to) = (middle(near, 1.0), middle(far, -1.0));
        if (to - from).dot(ahead) < 2.0
            || !self.is_free(from.min(to) - slab - Vec3::Y * 0.1, from.max(to) + slab + Vec3::Y * HEADROOM_M)
        {
            return None;
        }
        let (low, high) = (-slab + Vec3::Y * (RAISED_M - THICK_M), slab + Vec3::Y * RAISED_M);
        let away = MoverStop { offset: to - from, ..HERE };
        Some(mover(MoverKind::Platform, from, (low, high), 0.0, vec![HERE, away]))
    }

    /// A floor over a gap that is there and away in turn.
    fn floor(&mut self, feet: Vec3) -> Option<Mover> {
        let mut floor = self.sides().into_iter().find_map(|ahead| self.floor_towards(feet, ahead))?;
        (floor.travel_s, floor.dwell_s) = (0.5, DWELL_S + self.rng.random_range(0.0..3.0f32));
        Some(floor)
    }

    fn floor_towards(&self, feet: Vec3, ahead: Vec3) -> Option<Mover> {
        let (near, far) = self.banks(feet, ahead, SPAN_M)?;
        let (from, to) = (feet + ahead * (near - 0.2), feet + ahead * (far + 0.2));
        let aside = Vec3::new(1.0 - ahead.x.abs(), 0.0, 1.0 - ahead.z.abs()) * HALF_M;
        let (low, high) = (from.min(to) - aside, from.max(to) + aside);
        if !self.is_free(low + Vec3::Y * 0.35, high + Vec3::Y * HEADROOM_M) {
            return None;
        }
        let (low, high) = (low - feet + Vec3::Y * (RAISED_M - THICK_M), high - feet + Vec3::Y * RAISED_M);
        let away = MoverStop { is_there: false, ..HERE };
        Some(mover(MoverKind::Floor, feet, (low, high), 0.0, vec![HERE, away]))
    }

    /// A belt on level ground.
    fn conveyor(&mut self, feet: Vec3) -> Option<Mover> {
        let yaw = self.rng.random_range(0.0..TAU);
        let [half_width, half_length] = BELT_HALF_M;
        let turn = libm::sincosf(yaw);
        let spots = [-1.0, -0.5, 0.0, 0.5, 1.0].iter().flat_map(|z| [-1.0, 1.0].map(|x: f32| (x, *z)));
        let top =
            self.level(feet, spots.map(|(x, z)| turned(Vec3::new(x * half_width, 0.0, z * half_length), turn)))?;
        let reach = Vec3::new(half_length, 0.0, half_length);
        if !self.is_free(feet - reach + Vec3::Y * 0.4, feet + reach + Vec3::Y * HEADROOM_M) {
            return None;
        }
        let box_ = (Vec3::new(-half_width, -THICK_M, -half_length), Vec3::new(half_width, 0.1, half_length));
        let mut belt = mover(MoverKind::Conveyor, Vec3::new(feet.x, top, feet.z), box_, yaw, vec![HERE]);
        belt.belt = turned(Vec3::Z, turn) * BELT_SPEED;
        Some(belt)
    }

    /// A crate on level ground.
    fn crate_(&mut self, feet: Vec3) -> Option<Mover> {
        let half = 0.5 * self.rng.random_range(CRATE_M);
        let yaw = self.rng.random_range(0.0..TAU);
        let turn = libm::sincosf(yaw);
        let corners = [(-1.0, -1.0), (-1.0, 1.0), (1.0, -1.0), (1.0, 1.0), (0.0, 0.0)];
        let top = self.level(feet, corners.into_iter().map(|(x, z)| turned(Vec3::new(x, 0.0, z) * half, turn)))?;
        let reach = Vec3::new(1.5 * half, 0.0, 1.5 * half);
        if !self.is_free(feet - reach + Vec3::Y * 0.35, feet + reach + Vec3::Y * (2.0 * half + 0.1)) {
            return None;
        }
        let box_ = (Vec3::new(-half, 0.01, -half), Vec3::new(half, 2.0 * half, half));
        Some(mover(MoverKind::Crate, Vec3::new(feet.x, top, feet.z), box_, yaw, vec![HERE]))
    }

    /// The four directions along the axes, beginning with any.
    fn sides(&mut self) -> [Vec3; 4] {
        let mut sides = [Vec3::X, Vec3::Z, Vec3::NEG_X, Vec3::NEG_Z];
        sides.rotate_left(self.rng.random_range(0..4usize));
        sides
    }

    /// Sets the pace and the stay of a lift or platform.
    fn ridden(&mut self, mover: Mover) -> Mover {
        let travel_s = (mover.stops[0].offset.distance(mover.stops[1].offset) / SPEED).max(1.0);
        Mover { travel_s, dwell_s: DWELL_S + self.rng.random_range(0.0..2.0f32), ..mover }
    }

    /// Height of the highest level ground below a point, within `heights`, m.
    fn ground(&self, point: Vec3, heights: Range<f32>) -> Option<f32> {
        let extent = self.map.extent();
        if !(1.0..extent.x - 1.0).contains(&point.x) || !(1.0..extent.z - 1.0).contains(&point.z) {
            return None;
        }
        let (floors, count) = navigable::floors(self.map, &self.profile, point.x, point.z);
        floors[..count].iter().map(|(floor, _)| floor.y).find(|height| heights.contains(height))
    }

    /// Where a gap as wide as `widths` begins and ends that lies ahead of a place, m from there. Both banks are as high
    /// as the place.
    fn banks(&self, feet: Vec3, ahead: Vec3, widths: Range<f32>) -> Option<(f32, f32)> {
        const STEP_M: f32 = 0.5;
        let is_bank = |far: f32| self.ground(feet + ahead * far, feet.y - 0.4..feet.y + 0.4).is_some();
        let is_deep = |far: f32| {
            let hit = self.map.mesh().cast_ray(feet + ahead * far + Vec3::Y, DOWN, 1.0 + GAP_DEPTH_M);
            hit.is_none_or(|hit| matches!(hit.surface, Surface::Water | Surface::Lava))
        };
        let edge = (1..6).map(|step| STEP_M * step as f32).find(|far| !is_bank(*far))?;
        let steps = |far: f32| (far / STEP_M) as u32;
        let end = (1..steps(widths.end)).map(|step| edge + STEP_M * step as f32).find(|far| is_bank(*far))?;
        let near = edge - STEP_M;
        let inside = (steps(edge) + 1..steps(end) - 1).map(|step| STEP_M * step as f32);
        (widths.contains(&(end - near))
            && is_bank(end + 1.0)
            && inside.clone().count() > 2
            && inside.into_iter().all(is_deep))
        .then_some((near, end))
    }

    /// Height of the highest ground at these shifts from a place, if the ground is level there, m.
    fn level(&self, feet: Vec3, shifts: impl Iterator<Item = Vec3>) -> Option<f32> {
        let around = feet.y - LEVEL_M..feet.y + LEVEL_M;
        shifts
            .map(|shift| self.ground(feet + shift, around.clone()))
            .try_fold(f32::MIN, |top, height| Some(top.max(height?)))
    }

    /// Whether nothing of the map lies in a box.
    fn is_free(&self, low: Vec3, high: Vec3) -> bool {
        let mut found = Vec::new();
        self.map.mesh().gather_solids(low, high, &mut found);
        found.is_empty()
    }
}

/// A mover without a name: a box around `origin`, turned about the upright axis.
fn mover(kind: MoverKind, origin: Vec3, (low, high): (Vec3, Vec3), yaw: f32, stops: Vec<MoverStop>) -> Mover {
    let turn = libm::sincosf(yaw);
    let placed = |corner: Vec3| origin + turned(corner, turn);
    Mover {
        name: String::new(),
        kind,
        triangles: cuboid(low, high).into_iter().map(|corners| corners.map(placed)).collect(),
        pivot: origin,
        cycles: stops.len() > 1,
        stops,
        start: StopIdx(0),
        travel_s: 1.0,
        dwell_s: DWELL_S,
        belt: Vec3::ZERO,
    }
}
