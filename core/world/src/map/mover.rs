//! Movers: doors, lifts, platforms, floors that vanish, conveyors, and crates, as they belong to a map.
//!
//! A mover is a rigid piece of geometry that stands at stops and travels between neighbouring ones; a crate goes where
//! it is pushed. What it does at the moment is part of a world, see [`MoverState`](crate::MoverState).

use crate::aabb::Aabb;
use crate::float::turned;
use crate::mesh::{Surface, Triangle};
use crate::{StopIdx, StopSet, TICKS_PER_SECOND, Vec3};
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;
use strum::{IntoStaticStr, VariantArray};

/// Most movers of a map.
pub const MAX_MOVERS: usize = 1024;
/// Most triangles of all movers of a map.
pub const MAX_MOVER_TRIANGLES: usize = 65_536;
/// Most stops of a mover.
pub const MAX_STOPS: usize = 16;
/// Longest name of a mover, bytes.
pub const MAX_NAME_LEN: usize = 64;
/// Fastest a mover travels, m/s: bodies that it pushes must not tunnel through it.
pub const MAX_MOVER_SPEED: f32 = 10.0;
/// Largest coordinate of a mover, m.
pub(crate) const FARTHEST_M: f32 = 10_000.0;
/// Longest time of a journey or a stay at a stop, s.
pub const LONGEST_S: f32 = 600.0;

/// What a mover is to those who use it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, VariantArray, IntoStaticStr)]
#[serde(rename_all = "lowercase")]
#[strum(serialize_all = "lowercase")]
pub enum MoverKind {
    /// Closed at stop 0, open at the last stop.
    Door,
    /// Goes up and down.
    Lift,
    /// Goes sideways.
    Platform,
    /// Is there at stop 0, and not at stop 1.
    Floor,
    /// Stands still and carries what is on it.
    Conveyor,
    /// Is pushed by bodies, and falls.
    Crate,
}

impl MoverKind {
    /// All kinds.
    pub const ALL: &[MoverKind] = Self::VARIANTS;

    /// Lower-case name, as in levels.
    pub fn name(self) -> &'static str {
        self.into()
    }

    /// Whether bodies ride on it from stop to stop, and call it.
    pub fn is_ridden(self) -> bool {
        matches!(self, MoverKind::Lift | MoverKind::Platform)
    }
}

/// A place where a mover stands.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct MoverStop {
    /// Shift from where the mover was modelled, m.
    pub offset: Vec3,
    /// Turn about the upright axis through the pivot, rad.
    pub yaw: f32,
    /// Whether the mover is there at all.
    pub is_there: bool,
}

/// A rigid part of a map that moves.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Mover {
    /// Name, unique on the map.
    pub name: String,
    /// What it is to those who use it.
    pub kind: MoverKind,
    /// Corners of its triangles as it was modelled, counter-clockwise seen from outside, m.
    pub triangles: Vec<[Vec3; 3]>,
    /// Point about which it turns, m.
    pub pivot: Vec3,
    /// Where it stands, in the order in which it travels: 1 to 16.
    pub stops: Vec<MoverStop>,
    /// Index of the stop at which it begins.
    pub start: StopIdx,
    /// Duration of the journey from each stop to the next, s.
    pub travel_s: f32,
    /// How long it stays at each stop while it cycles, s.
    pub dwell_s: f32,
    /// Whether it travels from stop to stop and back by itself. Otherwise it waits for orders.
    pub cycles: bool,
    /// Velocity that it gives to what stands on it, m/s.
    pub belt: Vec3,
}

/// Why movers cannot be part of a map.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum MoverError {
    /// There are too many.
    #[error("the map has {0} movers, but at most {MAX_MOVERS} fit: make some of them static")]
    TooMany(usize),
    /// They have too many triangles.
    #[error("the movers of the map have {0} triangles, but at most {MAX_MOVER_TRIANGLES} fit: simplify them")]
    TooFine(usize),
    /// A name is empty, too long or not unique.
    #[error("the mover `{0}` needs a name of its own of 1 to {MAX_NAME_LEN} bytes")]
    Name(String),
    /// A mover has no geometry.
    #[error("the mover `{0}` has no triangle with an area")]
    Empty(String),
    /// The stops are too few, too many, or not those of its kind.
    #[error("the mover `{name}` has {count} stops from number {} on, but must have {expected}", .start.0)]
    Stops {
        /// Name of the mover.
        name: String,
        /// Number of its stops.
        count: usize,
        /// Stop at which it begins.
        start: StopIdx,
        /// What would be allowed.
        expected: &'static str,
    },
    /// A number is not finite or too large.
    #[error("the mover `{0}` has a position, time or speed that is out of range")]
    Number(String),
    /// It would travel too fast.
    #[error(
        "the mover `{name}` travels at {speed} m/s, but at most {MAX_MOVER_SPEED} m/s is possible: let it take longer"
    )]
    Speed {
        /// Name of the mover.
        name: String,
        /// Its speed, m/s.
        speed: f32,
    },
}

impl Mover {
    /// Duration of the journey to the next stop in ticks, at least 1.
    pub(crate) fn travel_ticks(&self) -> f32 {
        (self.travel_s * TICKS_PER_SECOND as f32).max(1.0)
    }

    /// How long it stays at each stop while it cycles, in ticks.
    pub fn dwell_ticks(&self) -> u32 {
        (self.dwell_s * TICKS_PER_SECOND as f32) as u32
    }

    /// The set of all its stops.
    pub fn all_stops(&self) -> StopSet {
        StopSet::first(self.stops.len())
    }

    /// Least and greatest coordinates at one stop, m.
    pub fn bounds_at(&self, stop: usize) -> (Vec3, Vec3) {
        let placed = self.triangles.iter().flatten().map(|corner| self.placed(self.stops[stop], *corner));
        placed.fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(low, high), corner| (low.min(corner), high.max(corner)))
    }

    /// The box around all its stops.
    pub fn reach(&self) -> Aabb {
        let boxes = (0..self.stops.len()).map(|stop| Aabb::from(self.bounds_at(stop)));
        boxes.reduce(Aabb::union).unwrap_or(Aabb::at(Vec3::ZERO))
    }

    /// Triangles at one stop.
    pub fn triangles_at(&self, stop: MoverStop) -> Vec<Triangle> {
        let placed = |corners: &[Vec3; 3]| corners.map(|corner| self.placed(stop, corner));
        self.triangles.iter().filter_map(|corners| Triangle::new(placed(corners), Surface::Ground)).collect()
    }

    /// Where a point of the mover is at a stop, m.
    pub(crate) fn placed(&self, stop: MoverStop, point: Vec3) -> Vec3 {
        if stop.yaw == 0.0 {
            return point + stop.offset;
        }
        self.pivot + turned(point - self.pivot, libm::sincosf(stop.yaw)) + stop.offset
    }

    /// The pose at a share of the way from one stop to another.
    pub(crate) fn between(&self, from: StopIdx, to: StopIdx, share: f32) -> MoverStop {
        let (from, to) = (self.stops[from.idx()], self.stops[to.idx()]);
        MoverStop {
            offset: from.offset + (to.offset - from.offset) * share,
            yaw: from.yaw + (to.yaw - from.yaw) * share,
            is_there: from.is_there,
        }
    }

    /// Largest distance from the pivot, seen from above, m.
    fn arm(&self) -> f32 {
        let corners = self.triangles.iter().flatten();
        corners.map(|corner| libm::hypotf(corner.x - self.pivot.x, corner.z - self.pivot.z)).fold(0.0, f32::max)
    }

    /// Fastest that any part of it moves at the usual pace, m/s.
    pub fn speed(&self) -> f32 {
        let arm = self.arm();
        let metres =
            |pair: &[MoverStop]| pair[0].offset.distance(pair[1].offset) + (pair[0].yaw - pair[1].yaw).abs() * arm;
        let farthest = self.stops.windows(2).map(metres).fold(0.0, f32::max);
        farthest / (self.travel_ticks() / TICKS_PER_SECOND as f32)
    }

    fn check(&self) -> Result<(), MoverError> {
        let name = || self.name.clone();
        if !(1..=MAX_NAME_LEN).contains(&self.name.len()) {
            return Err(MoverError::Name(name()));
        }
        let expected = match self.kind {
            MoverKind::Door | MoverKind::Floor if self.stops.len() != 2 => Some("2 stops"),
            MoverKind::Conveyor | MoverKind::Crate if self.stops.len() != 1 => Some("1 stop"),
            MoverKind::Lift | MoverKind::Platform if !(2..=MAX_STOPS).contains(&self.stops.len()) => {
                Some("2 to 16 stops")
            }
            _ if self.start.idx() >= self.stops.len() => Some("a start that is one of its stops"),
            _ => None,
        };
        if let Some(expected) = expected {
            return Err(MoverError::Stops { name: name(), count: self.stops.len(), start: self.start, expected });
        }
        // These comparisons are false for NaN.
        let is_near = |point: Vec3| point.abs().max_element() <= FARTHEST_M && point.is_finite();
        let lasts = |seconds: f32| (0.0..=LONGEST_S).contains(&seconds);
        let is_sane = self.triangles.iter().flatten().all(|corner| is_near(*corner))
            && self.stops.iter().all(|stop| is_near(stop.offset) && stop.yaw.abs() <= std::f32::consts::TAU)
            && is_near(self.pivot)
            && lasts(self.travel_s)
            && lasts(self.dwell_s)
            && self.belt.length() <= MAX_MOVER_SPEED;
        if !is_sane {
            return Err(MoverError::Number(name()));
        }
        if self.triangles_at(self.stops[0]).is_empty() {
            return Err(MoverError::Empty(name()));
        }
        let speed = self.speed();
        if speed > MAX_MOVER_SPEED * 1.001 {
            return Err(MoverError::Speed { name: name(), speed });
        }
        Ok(())
    }
}

/// Checks all movers of a map.
///
/// # Errors
/// If one of them is not valid, or they are too many.
pub(super) fn check(movers: &[Mover]) -> Result<(), MoverError> {
    if movers.len() > MAX_MOVERS {
        return Err(MoverError::TooMany(movers.len()));
    }
    let triangle_count = movers.iter().map(|mover| mover.triangles.len()).sum();
    if triangle_count > MAX_MOVER_TRIANGLES {
        return Err(MoverError::TooFine(triangle_count));
    }
    let mut names = BTreeSet::new();
    for mover in movers {
        mover.check()?;
        if !names.insert(&mover.name) {
            return Err(MoverError::Name(mover.name.clone()));
        }
    }
    Ok(())
}

/// The faces of a box, counter-clockwise seen from outside.
pub fn cuboid(low: Vec3, high: Vec3) -> Vec<[Vec3; 3]> {
    const QUADS: [[usize; 4]; 6] = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
    let corner = |idx: usize| {
        let pick = |axis: usize| if idx >> axis & 1 == 1 { high[axis] } else { low[axis] };
        Vec3::new(pick(0), pick(1), pick(2))
    };
    let halves = |[a, b, c, d]: [usize; 4]| [[a, b, c], [a, c, d]].map(|face| face.map(corner));
    QUADS.into_iter().flat_map(halves).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_faces_of_a_box_look_outwards() {
        let (low, high) = (Vec3::new(1.0, 2.0, 3.0), Vec3::new(2.0, 4.0, 6.0));
        for corners in cuboid(low, high) {
            let triangle = Triangle::new(corners, Surface::Ground).expect("a face");
            assert!(triangle.normal().dot(corners[0] - (low + high) * 0.5) > 0.0, "{corners:?}");
        }
    }
}
