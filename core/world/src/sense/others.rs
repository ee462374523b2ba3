//! Other bodies in an observation: NPCs and players.

use super::cone::{RAY_COUNT, RAY_RANGE_M, RAY_SIDE, RayCone};
use crate::Vec3;
use crate::character::Body;
use crate::map::Map;
use crate::movers::Movers;
use crate::slot::BodySlot;

/// Greatest number of other bodies that an observation describes one by one.
const NEAREST: usize = 4;
/// Values of each of them: 0..3 its position from the observer's feet / 12 m and 3..6 its velocity less the observer's
/// / 12 m/s, both in the observer's frame (x right, y up, z forward), and 6 its proximity `1 - d / 12 m`, 0 if there is
/// none.
const VALUES: usize = 7;
/// Distance up to which bodies are described one by one, m.
const RANGE_M: f32 = 12.0;
/// Speed at which the velocity of another body is 1, m/s.
const SPEED: f32 = 12.0;
/// Length of the part of an observation about other bodies: the proximity of each ray that ends on a body, then the
/// nearest bodies in sight.
pub const OTHERS_LEN: usize = RAY_COUNT + NEAREST * VALUES;
/// Horizontal distance beyond which no part of another body is visible, m: the length of a ray, the height of the
/// tallest body (5 m), and slack.
pub(crate) const REACH_M: f32 = RAY_RANGE_M + 6.0;

/// Another body, an upright cylinder.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Other {
    /// Lowest point, m.
    pub feet: Vec3,
    /// Velocity, m/s.
    pub velocity: Vec3,
    /// Radius, m.
    pub radius: f32,
    /// Height, m.
    pub height: f32,
}

impl Other {
    /// Horizontal distances between which a ray from `eye` is above, below or inside the body, m. `heading` is the
    /// horizontal unit direction of the ray (x, z).
    fn chord(&self, eye: Vec3, heading: (f32, f32)) -> Option<(f32, f32)> {
        let offset = self.feet - eye;
        let along = offset.x * heading.0 + offset.z * heading.1;
        let aside = offset.x * heading.1 - offset.z * heading.0;
        let half_squared = self.radius * self.radius - aside * aside;
        if half_squared <= 0.0 {
            return None;
        }
        let half = half_squared.sqrt();
        (along + half > 0.0).then_some(((along - half).max(0.0), along + half))
    }

    /// Horizontal distance at which a ray that rises by `slope` per metre enters the body on that chord, m.
    fn entered_by(&self, eye: Vec3, (near, far): (f32, f32), slope: f32) -> Option<f32> {
        // Between these distances the ray is between soles and crown.
        let (bottom, top) = ((self.feet.y - eye.y) / slope, (self.feet.y + self.height - eye.y) / slope);
        let (first, last) = (near.max(bottom.min(top)), far.min(bottom.max(top)));
        (first <= last).then_some(first)
    }

    fn middle(&self) -> Vec3 {
        self.feet + Vec3::Y * (0.5 * self.height)
    }
}

/// Calls `found` with the index of each ray of the cone that hits one of `others`, and the distance of the first hit,
/// m.
pub(crate) fn cast_cone(
    cone: &RayCone,
    eye: Vec3,
    body: &Body,
    others: impl Iterator<Item = Other>,
    mut found: impl FnMut(usize, f32),
) {
    let headings = cone.headings(body);
    let mut nearest = [RAY_RANGE_M; RAY_COUNT];
    for other in others.filter(|other| other.feet.distance(eye) < RAY_RANGE_M + other.height) {
        for (column, &heading) in headings.iter().enumerate() {
            let Some(chord) = other.chord(eye, heading) else { continue };
            for row in 0..RAY_SIDE {
                let (slope, stretch) = cone.slope(row);
                let distance = other.entered_by(eye, chord, slope).map_or(RAY_RANGE_M, |distance| distance * stretch);
                let ray = row * RAY_SIDE + column;
                nearest[ray] = nearest[ray].min(distance);
            }
        }
    }
    for (ray, distance) in nearest.into_iter().enumerate().filter(|(_, distance)| *distance < RAY_RANGE_M) {
        found(ray, distance);
    }
}

/// Writes the visible bodies into `row`, which has [`OTHERS_LEN`] values. `proximities` are those of the rays on the
/// map.
pub(crate) fn observe(
    cone: &RayCone,
    (map, movers): (&Map, &Movers),
    (eye, body): (Vec3, &Body),
    others: impl Iterator<Item = (BodySlot, Other)>,
    proximities: &[f32],
    row: &mut [f32],
) {
    row.fill(0.0);
    let (rays, states) = row.split_at_mut(RAY_COUNT);
    let mut near = Vec::new();
    let others = others.map(|(slot, other)| {
        let distance = other.feet.distance(body.feet);
        if distance < RANGE_M {
            near.push((distance, slot, other));
        }
        other
    });
    cast_cone(cone, eye, body, others, |ray, distance| note_ray(rays, ray, distance, proximities[ray]));
    near.sort_unstable_by(|one, other| one.0.total_cmp(&other.0).then(one.1.cmp(&other.1)));
    let seen = near.iter().map(|(.., other)| other).filter(|other| is_in_sight(map, movers, eye, other.middle()));
    describe(body, seen.map(|other| (other.feet, other.velocity)), states);
}

/// Writes a ray that ends on another body after `distance`, m, unless the map, at `proximity`, is nearer. `rays` are
/// zeros.
fn note_ray(rays: &mut [f32], ray: usize, distance: f32, proximity: f32) {
    let nearer = 1.0 - distance / RAY_RANGE_M;
    if nearer > proximity {
        rays[ray] = nearer;
    }
}

/// Describes the first of the visible bodies, given by feet, m, and velocity, m/s, in `states`, which are zeros.
fn describe(body: &Body, seen: impl Iterator<Item = (Vec3, Vec3)>, states: &mut [f32]) {
    for ((feet, velocity), values) in seen.zip(states.chunks_exact_mut(VALUES)) {
        let place = body.to_local(feet - body.feet) / RANGE_M;
        let velocity = body.to_local(velocity - body.velocity) / SPEED;
        let proximity = 1.0 - feet.distance(body.feet) / RANGE_M;
        values.copy_from_slice(&[place.x, place.y, place.z, velocity.x, velocity.y, velocity.z, proximity]);
    }
}

/// Like [`observe`], from the distances, m, at which rays hit bodies, and the feet, m, and velocities, m/s, of the
/// visible bodies. Allocates nothing.
pub(crate) fn observe_found(
    body: &Body,
    hits: impl Iterator<Item = (usize, f32)>,
    seen: impl Iterator<Item = (Vec3, Vec3)>,
    proximities: &[f32],
    row: &mut [f32],
) {
    row.fill(0.0);
    let (rays, states) = row.split_at_mut(RAY_COUNT);
    hits.filter(|(_, distance)| *distance < RAY_RANGE_M)
        .for_each(|(ray, distance)| note_ray(rays, ray, distance, proximities[ray]));
    let mut nearest = [(RANGE_M, Vec3::ZERO, Vec3::ZERO); NEAREST];
    for (feet, velocity) in seen {
        let distance = feet.distance(body.feet);
        let at = nearest.partition_point(|(nearer, ..)| *nearer <= distance);
        if at < NEAREST && distance < RANGE_M {
            nearest[at..].rotate_right(1);
            nearest[at] = (distance, feet, velocity);
        }
    }
    let found = nearest.into_iter().filter(|(distance, ..)| *distance < RANGE_M);
    describe(body, found.map(|(_, feet, velocity)| (feet, velocity)), states);
}

/// Whether nothing solid is between two places.
fn is_in_sight(map: &Map, movers: &Movers, eye: Vec3, place: Vec3) -> bool {
    let distance = eye.distance(place);
    let Some(direction) = (place - eye).try_normalize() else { return true };
    let blocks = map.mesh().cast_ray(eye, direction, distance).is_some_and(|hit| hit.surface.is_solid());
    let mut is_clear = !blocks;
    movers.cast_cone(eye, &[direction], distance, |_, _| is_clear = false);
    is_clear
}

/// Mirrors the part about other bodies left to right, in place; its own inverse.
pub(crate) fn mirror(row: &mut [f32]) {
    let (rays, states) = row.split_at_mut(RAY_COUNT);
    rays.chunks_mut(RAY_SIDE).for_each(<[f32]>::reverse);
    for values in states.chunks_exact_mut(VALUES) {
        (values[0], values[3]) = (-values[0], -values[3]);
    }
}
