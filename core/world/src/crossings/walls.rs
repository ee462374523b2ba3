//! Runs along walls: from the last place to stand beside a wall to the first one behind a gap in the ground there.

use super::approach::Approach;
use crate::character::CharacterProfile;
use crate::map::CollisionMap;
use crate::mesh::WallFace;
use crate::navigable::{floors, nearest_floor};
use crate::{Ability, Vec3};

/// Longest way between two places beside a wall, and shortest gap between them, m. Jumps do what is shorter.
const LONGEST_M: f32 = 40.0;
const LEAST_GAP_M: f32 = 2.0;
/// Greatest distance of a way from its wall, m, and least cosine of the angle between them.
const BESIDE_M: f32 = 4.0;
const LEAST_ALONG: f32 = 0.85;
/// Distance of a run from its wall besides the radius, m, and how far into the wall the body heads at its end.
const CLEAR_M: f32 = 0.05;
const INTO_M: f32 = 0.8;
/// Least height of a wall, m.
const LEAST_HEIGHT_M: f32 = 1.5;
/// Distance between two places beside a wall that are tried, and greatest height of one above or below the last, m.
const SAMPLE_M: f32 = 0.25;
const STEP_M: f32 = 0.5;
/// Greatest height of the landing above the take-off, and below it, m.
const RISE_M: f32 = 1.5;
const DROP_M: f32 = 4.0;
/// How far the landing is behind the rim, and how far behind the landing the body heads, m.
const LANDING_M: f32 = 0.75;
const BEYOND_M: f32 = 3.0;

/// The ground beside a wall.
struct Beside<'a> {
    map: &'a CollisionMap,
    profile: &'a CharacterProfile,
    out: Vec3,
}

/// The run along a wall by which a body could get from one place to another, m.
pub(super) fn run_between(map: &CollisionMap, profile: &CharacterProfile, [from, to]: [Vec3; 2]) -> Option<Approach> {
    let way = (to - from).with_y(0.0);
    let is_possible = profile.wall_run_seconds > 0.0 && way.length() > LEAST_GAP_M && way.length() < LONGEST_M;
    if !is_possible || to.y - from.y > RISE_M || from.y - to.y > DROP_M {
        return None;
    }
    let aside = Vec3::new(-way.z, 0.0, way.x).normalize();
    let middle = from.midpoint(to).with_y(from.y + 0.5 * profile.height);
    let hits = [aside, -aside].into_iter().filter_map(|side| {
        let hit = map.mesh().cast_ray(middle, side, BESIDE_M)?;
        let out = map.mesh().triangles()[hit.triangle_idx as usize].normal();
        let is_wall = hit.surface.is_solid() && WallFace::is_upright(out) && out.dot(side) < 0.0;
        is_wall.then_some((hit.distance, middle + side * hit.distance, out.with_y(0.0).normalize()))
    });
    let (_, wall, out) = hits.min_by(|one, other| one.0.total_cmp(&other.0))?;
    if (way - out * way.dot(out)).length() < LEAST_ALONG * way.length() {
        return None;
    }
    let off = profile.radius + CLEAR_M;
    let line = |place: Vec3| place + out * (off - (place - wall).dot(out));
    Beside { map, profile, out }.run([line(from), line(to)])
}

/// The runs along all walls of a map.
pub(super) fn runs(map: &CollisionMap, profile: &CharacterProfile) -> Vec<Approach> {
    let mut found = Vec::new();
    for face in map.mesh().wall_faces(LEAST_HEIGHT_M, LEAST_GAP_M) {
        let beside = Beside { map, profile, out: face.out };
        let off = face.out * (profile.radius + CLEAR_M);
        let [left, right] = face.ends().map(|end| end + off);
        let count = (left.distance(right) / SAMPLE_M).floor();
        let along = (right - left).normalize_or_zero();
        for idx in 0..=count as u32 {
            let here = left + along * (SAMPLE_M * idx as f32);
            let (floors, floor_count) = floors(map, profile, here.x, here.z);
            let heights = floors[..floor_count].iter().map(|(floor, _)| floor.y);
            let reach = face.low - DROP_M..face.low + face.height;
            for from in heights.filter(|height| reach.contains(height)).map(|height| here.with_y(height)) {
                for direction in [along, -along] {
                    if beside.at(from + direction * SAMPLE_M, STEP_M).is_none() {
                        found.extend(beside.run([from, from + direction * LONGEST_M]));
                    }
                }
            }
        }
    }
    found
}

impl Beside<'_> {
    /// The floor nearest in height to a place, m, at most `most` higher or lower.
    fn at(&self, place: Vec3, most: f32) -> Option<Vec3> {
        nearest_floor(self.map, self.profile, place, most).map(|floor| place.with_y(floor.y))
    }

    /// The run from one place beside the wall towards another, over the first gap on the way.
    fn run(&self, [from, to]: [Vec3; 2]) -> Option<Approach> {
        let along = (to - from).with_y(0.0).try_normalize()?;
        let count = ((to - from).with_y(0.0).length() / SAMPLE_M) as u32;
        let mut rim = self.at(from, STEP_M)?;
        let mut is_over_gap = false;
        for idx in 1..=count {
            let place = (from + along * (SAMPLE_M * idx as f32)).with_y(rim.y);
            let ahead = (place - rim).dot(along);
            let most = if is_over_gap { DROP_M } else { STEP_M };
            match self.at(place, most).filter(|floor| (-DROP_M..=RISE_M).contains(&(floor.y - rim.y))) {
                // What is shorter is no gap, such as the foot of another wall.
                Some(floor) if ahead < LEAST_GAP_M => (rim, is_over_gap) = (floor, false),
                Some(floor) if self.has_wall(place) => {
                    let to = floor + along * LANDING_M;
                    let toward = to + along * BEYOND_M - self.out * INTO_M;
                    return Some(Approach { at: rim, toward, to, by: Ability::WALL_RUN });
                }
                // The run ends with the wall.
                _ if ahead >= LEAST_GAP_M && !self.has_wall(place) => return None,
                _ => is_over_gap = true,
            }
        }
        None
    }

    /// Whether the wall is beside a place.
    fn has_wall(&self, place: Vec3) -> bool {
        let middle = place + Vec3::Y * (0.5 * self.profile.height);
        let hit = self.map.mesh().cast_ray(middle, -self.out, self.profile.radius + 2.0 * CLEAR_M + INTO_M);
        hit.is_some_and(|hit| hit.surface.is_solid())
    }
}
