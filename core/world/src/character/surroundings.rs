//! The solid triangles near a body, kept from tick to tick. A move reads the map again only after the body has left the
//! known box.

use super::profile::CharacterProfile;
use crate::Vec3;
use crate::mesh::{Contact, LANES, Mesh, Triangle, bits};

/// Triangles are gathered ahead of a body as far as its velocity takes it in this time, s, at most this far, m, plus a
/// margin, m.
const LOOK_AHEAD_S: f32 = 0.15;
const MAX_AHEAD_M: f32 = 3.0;
const MARGIN_M: f32 = 0.3;
/// Slack of the test that excludes triangles before the exact test, m.
const PLANE_SLACK_M: f32 = 1.0e-3;
/// Smallest difference at which one contact is deeper than another, m.
const DEEPER_M: f32 = 1.0e-6;
/// Contacts shallower than this are ignored, in metres.
const CONTACT_SLOP_M: f32 = 1.0e-4;

/// Scratch memory of the controller, reused so that a tick does not allocate.
///
/// Its content makes the moves of one body cheaper, but never changes their result. Any body on any map may use it.
#[derive(Debug, Default)]
pub struct MoveScratch {
    /// The mesh, and the box whose solid triangles are known.
    known: Option<(u64, Vec3, Vec3)>,
    triangles: Vec<Triangle>,
    planes: Vec<Planes>,
    /// For each block, bit `n` is set if triangle `n` touches the box of the current move.
    touched: Vec<u8>,
    indices: Vec<u32>,
    /// Solid triangles of movers.
    obstacles: Vec<Triangle>,
    slope: Slope,
}

/// The steepest slope that a character can stand on.
#[derive(Debug, Clone, Copy)]
pub(super) struct Slope {
    /// Angle, rad.
    angle: f32,
    /// Least upright component of the normal of walkable ground.
    pub cos: f32,
    /// Rise per metre.
    pub tan: f32,
}

impl Default for Slope {
    fn default() -> Self {
        Self { angle: 0.0, cos: 1.0, tan: 0.0 }
    }
}

/// Planes and bounds of eight triangles.
#[derive(Debug, Clone, Copy)]
struct Planes {
    normals: [[f32; LANES]; 3],
    /// Component of a corner along the normal.
    offsets: [f32; LANES],
    lows: [[f32; LANES]; 3],
    highs: [[f32; LANES]; 3],
}

impl Planes {
    /// No triangle: its bounds touch no box.
    const NONE: Self = Self {
        normals: [[0.0; LANES]; 3],
        offsets: [0.0; LANES],
        lows: [[f32::INFINITY; LANES]; 3],
        highs: [[f32::NEG_INFINITY; LANES]; 3],
    };

    fn set(&mut self, lane: usize, triangle: &Triangle) {
        let (low, high) = triangle.bounds();
        for axis in 0..3 {
            self.normals[axis][lane] = triangle.normal()[axis];
            self.lows[axis][lane] = low[axis];
            self.highs[axis][lane] = high[axis];
        }
        self.offsets[lane] = triangle.normal().dot(triangle.corners()[0]);
    }

    /// The triangles whose bounds touch the box.
    fn touching(&self, low: Vec3, high: Vec3) -> u8 {
        let touches =
            |lane: usize, axis: usize| (self.lows[axis][lane] <= high[axis]) & (self.highs[axis][lane] >= low[axis]);
        bits(std::array::from_fn(|lane| touches(lane, 0) & touches(lane, 1) & touches(lane, 2))) as u8
    }

    /// Least signed distance of an upright segment from each plane, and the triangles whose planes a capsule around the
    /// segment may touch from the front.
    fn within_reach(&self, low: Vec3, height: f32, radius: f32) -> ([f32; LANES], u8) {
        let (mut lower, mut upper) = ([0.0; LANES], [0.0; LANES]);
        for lane in 0..LANES {
            let [nx, ny, nz] = [0, 1, 2].map(|axis| self.normals[axis][lane]);
            let side = nx * low.x + ny * low.y + nz * low.z - self.offsets[lane];
            let rise = ny * height;
            lower[lane] = side + if rise < 0.0 { rise } else { 0.0 };
            upper[lane] = side + if rise < 0.0 { 0.0 } else { rise };
        }
        let close = |lane| (lower[lane] <= radius + PLANE_SLACK_M) & (upper[lane] >= -PLANE_SLACK_M);
        (lower, bits(std::array::from_fn(close)) as u8)
    }
}

impl MoveScratch {
    /// The steepest slope of a profile; its trigonometric functions are computed only when the profile changes.
    pub(super) fn slope(&mut self, profile: &CharacterProfile) -> Slope {
        let angle = profile.max_slope;
        if self.slope.angle != angle {
            self.slope = Slope { angle, cos: libm::cosf(angle), tan: libm::tanf(angle) };
        }
        self.slope
    }

    /// Selects the solid triangles whose bounds touch the box of a move, and gathers those ahead of a body with this
    /// velocity.
    pub(super) fn select(&mut self, mesh: &Mesh, low: Vec3, high: Vec3, velocity: Vec3) {
        let is_known = self.known.is_some_and(|(of, known_low, known_high)| {
            of == mesh.id() && low.cmpge(known_low).all() && high.cmple(known_high).all()
        });
        if !is_known {
            let ahead = (velocity * LOOK_AHEAD_S).clamp_length_max(MAX_AHEAD_M);
            let (low, high) = (low.min(low + ahead), high.max(high + ahead));
            self.gather(mesh, low - Vec3::splat(MARGIN_M), high + Vec3::splat(MARGIN_M));
        }
        self.touched.clear();
        self.touched.extend(self.planes.iter().map(|planes| planes.touching(low, high)));
    }

    /// Removes all obstacles besides the map.
    pub(crate) fn begin_obstacles(&mut self) {
        self.obstacles.clear();
    }

    /// Adds solid triangles that block the next moves, besides those of the map.
    pub(crate) fn add_obstacles(&mut self, triangles: &[Triangle]) {
        self.obstacles.extend_from_slice(triangles);
    }

    fn gather(&mut self, mesh: &Mesh, low: Vec3, high: Vec3) {
        mesh.gather_solids(low, high, &mut self.indices);
        self.triangles.clear();
        self.triangles.extend(self.indices.iter().map(|&idx| mesh.triangles()[idx as usize]));
        self.planes.clear();
        self.planes.resize(self.triangles.len().div_ceil(LANES), Planes::NONE);
        for (idx, triangle) in self.triangles.iter().enumerate() {
            self.planes[idx / LANES].set(idx % LANES, triangle);
        }
        self.known = Some((mesh.id(), low, high));
    }

    /// The deepest contact of a body with the selected triangles; of equally deep contacts, that with the first
    /// triangle.
    pub(crate) fn deepest_contact(&self, profile: &CharacterProfile, feet: Vec3) -> Option<Contact> {
        let low = feet + Vec3::new(0.0, profile.radius, 0.0);
        let height = profile.height - 2.0 * profile.radius;
        let mut deepest: Option<Contact> = None;
        for (block, (planes, touched)) in self.planes.iter().zip(&self.touched).enumerate() {
            if *touched == 0 {
                continue;
            }
            let (distances, mut close) = planes.within_reach(low, height, profile.radius);
            close &= touched;
            while close != 0 {
                let lane = close.trailing_zeros() as usize % LANES;
                close &= close - 1;
                // No contact is deeper than the contact with the whole plane.
                let depth = deepest.map_or(CONTACT_SLOP_M, |best| best.depth + DEEPER_M);
                if distances[lane] >= 0.0 && profile.radius - distances[lane] <= depth {
                    continue;
                }
                if let Some(contact) = self.triangles[block * LANES + lane].capsule_contact(low, height, profile.radius)
                    && contact.depth > depth
                {
                    deepest = Some(contact);
                }
            }
        }
        for obstacle in &self.obstacles {
            let depth = deepest.map_or(CONTACT_SLOP_M, |best| best.depth + DEEPER_M);
            let contact = obstacle.capsule_contact(low, height, profile.radius);
            deepest = contact.filter(|contact| contact.depth > depth).or(deepest);
        }
        deepest
    }
}
