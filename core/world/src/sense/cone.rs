//! The cone of 8 x 8 rays of an observation, denser ahead.

use crate::Vec3;
use crate::character::{Body, CharacterProfile};
use crate::map::Map;
use crate::mesh::{ConeHit, Elevations, LANES, Surface};
use crate::movers::Movers;

/// Rays per row and per column of the cone.
pub const RAY_SIDE: usize = LANES;
/// Rays of an observation.
pub const RAY_COUNT: usize = RAY_SIDE * RAY_SIDE;
/// Reach of every ray, m.
pub const RAY_RANGE_M: f32 = 30.0;

/// Height of the rays' origin as a share of the body's height.
const EYE_HEIGHT_SHARE: f32 = 0.85;
/// Azimuth of each ray of a row, degrees, positive to the right: denser ahead, symmetric for mirroring.
const AZIMUTHS_DEG: [f32; RAY_SIDE] = [-80.0, -45.0, -22.0, -7.0, 7.0, 22.0, 45.0, 80.0];
/// Elevation of each row, degrees.
const ELEVATIONS_DEG: [f32; RAY_SIDE] = [-65.0, -42.0, -26.0, -14.0, -5.0, 6.0, 22.0, 45.0];

/// Height of the rays' origin above the feet, m.
pub fn eye_height(profile: &CharacterProfile) -> f32 {
    profile.height * EYE_HEIGHT_SHARE
}

/// Cone of rays in the body's frame (x right, y up, z forward).
#[derive(Debug, Clone)]
pub struct RayCone {
    directions: [Vec3; RAY_COUNT],
    elevations: Elevations,
    /// Sine and cosine of each azimuth.
    azimuths: [(f32, f32); RAY_SIDE],
}

impl Default for RayCone {
    fn default() -> Self {
        let elevations = Elevations::new(ELEVATIONS_DEG.map(f32::to_radians), RAY_RANGE_M);
        let azimuths = AZIMUTHS_DEG.map(|azimuth| libm::sincosf(azimuth.to_radians()));
        Self { directions: directions(&elevations, azimuths), elevations, azimuths }
    }
}

impl RayCone {
    /// Unit directions in the body's frame, in the order of an observation.
    pub fn directions(&self) -> &[Vec3; RAY_COUNT] {
        &self.directions
    }

    /// Origin of the rays, m.
    pub fn eye(profile: &CharacterProfile, body: &Body) -> Vec3 {
        body.feet + Vec3::new(0.0, eye_height(profile), 0.0)
    }

    /// The azimuths in the map's frame, as horizontal unit vectors (x, z).
    pub(crate) fn headings(&self, body: &Body) -> [(f32, f32); RAY_SIDE] {
        let (sin, cos) = libm::sincosf(body.yaw);
        self.azimuths.map(|(right, ahead)| (sin * ahead - cos * right, cos * ahead + sin * right))
    }

    /// Unit directions in the map's frame, in the order of an observation.
    pub fn directions_of(&self, body: &Body) -> [Vec3; RAY_COUNT] {
        directions(&self.elevations, self.headings(body))
    }

    /// Rise of the rays of a row per horizontal metre, m, and their length per horizontal metre, m.
    pub(crate) fn slope(&self, row: usize) -> (f32, f32) {
        self.elevations.slope(row)
    }

    /// Casts the cone from `body` and calls `found` with the index, distance (m) and surface of each ray that hits.
    pub fn cast(&self, map: &Map, profile: &CharacterProfile, body: &Body, mut found: impl FnMut(usize, f32, Surface)) {
        let hits = map.cones().cast(&self.elevations, Self::eye(profile, body), &self.headings(body));
        for (idx, hit) in hits.as_flattened().iter().enumerate() {
            if let Some(ConeHit { distance, surface }) = *hit {
                found(idx, distance, surface);
            }
        }
    }

    /// Casts the cone from `body` at the map and its movers and calls `found` with the index, distance (m) and surface
    /// of each ray that hits.
    pub(crate) fn cast_with(
        &self,
        map: &Map,
        movers: &Movers,
        profile: &CharacterProfile,
        body: &Body,
        mut found: impl FnMut(usize, f32, Surface),
    ) {
        if movers.is_empty() {
            return self.cast(map, profile, body, found);
        }
        let mut hits: [Option<(f32, Surface)>; RAY_COUNT] = [None; RAY_COUNT];
        self.cast(map, profile, body, |idx, distance, surface| hits[idx] = Some((distance, surface)));
        movers.cast_cone(Self::eye(profile, body), &self.directions_of(body), RAY_RANGE_M, |idx, distance| {
            if hits[idx].is_none_or(|(nearest, _)| distance < nearest) {
                hits[idx] = Some((distance, Surface::Ground));
            }
        });
        for (idx, hit) in hits.into_iter().enumerate() {
            if let Some((distance, surface)) = hit {
                found(idx, distance, surface);
            }
        }
    }
}

/// Unit directions of all rays at these headings, in the order of an observation.
fn directions(elevations: &Elevations, headings: [(f32, f32); RAY_SIDE]) -> [Vec3; RAY_COUNT] {
    let mut directions = [Vec3::ZERO; RAY_COUNT];
    for (column, heading) in headings.into_iter().enumerate() {
        for (row, direction) in elevations.directions(heading).into_iter().enumerate() {
            directions[row * RAY_SIDE + column] = direction;
        }
    }
    directions
}
