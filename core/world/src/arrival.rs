//! When a body has arrived at a place.

use crate::aabb::Aabb;
use crate::character::{Body, CharacterProfile, MoveScratch, is_clear};
use crate::float::horizontal;
use crate::map::{Liquid, Map};
use crate::movers::Movers;
use crate::navigable::DOWN;
use crate::{TICKS_PER_SECOND, Vec3};
use serde::{Deserialize, Serialize};

/// Distance between two points of a walk at which the ground is searched, m.
const STRIDE_M: f32 = 0.25;
/// Halvings of a stride in which a rim is found: to about 2 cm.
const RIM_BISECTIONS: u32 = 4;
/// Height up to which a body still stands on the ground, m: the lowest point of a capsule on a slope is not above the
/// ground that it touches.
const SLACK_M: f32 = 0.25;
/// Rise of level ground within a stride that counts as continuous for bodies with low steps, m, and what it is higher
/// than the steps of others.
const LEAST_RISE_M: f32 = 0.35;
const RISE_SLACK_M: f32 = 0.05;
/// Heights above the feet at which nothing solid may lie between a body and a place, as shares of the body's height.
const OPEN_AT: [f32; 2] = [0.25, 0.75];
/// Number of lines that must be open between a body and a place.
pub const LINE_COUNT: usize = OPEN_AT.len();
/// Difference in height between the feet and a goal that always passes on ground that only a game knows, m.
const LIFT_M: f32 = 0.6;
/// Distance from a place to stand at which there must be ground all around, in radii of the body.
const RIM_RADII: f32 = 1.2;
/// Most steps away from what is near, and the least length of such a step, m.
const ROOM_STEPS: u8 = 6;
const LEAST_STEP_M: f32 = 0.03;
/// Faces of liquids and devices above the ground that a search for ground passes.
const MAX_FACES: usize = 4;

/// What counts as having arrived at a place.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub enum Arrival {
    /// The feet are within the radius, wherever they are (paper).
    #[default]
    Touch,
    /// The feet are within the radius, and nothing solid lies between the body and the place: for waypoints, which are
    /// passed on the run or in flight.
    Pass,
    /// The body stands on walkable ground within the radius and could walk straight to the place, so no wall, gap or
    /// floor lies between.
    Stand,
}

/// Distance by which a goal may be moved to a place to stand, unless the client says otherwise, m.
pub const SNAP_M: f32 = 2.0;
/// How much farther than its radius a target gets away from an NPC that keeps to it, until the NPC follows again, m.
pub const KEEP_SLACK_M: f32 = 0.5;
/// Time after which an NPC that keeps to its target tries again to reach it.
pub const RETRY_TICKS: u64 = 3 * TICKS_PER_SECOND as u64;
/// Distance between the places that are tried around a goal, m, and directions that are tried.
const SNAP_STEP_M: f32 = 0.25;
const SNAP_SPOKES: u8 = 12;
/// Heights above a goal from which the ground below it is searched, m.
const ABOVE_M: [f32; 3] = [0.3, 1.0, 2.0];

/// Why there is no place to stand near a goal.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NoFooting {
    /// The goal lies in solid ground, or a body does not fit there.
    InSolid,
    /// There is no ground that can be walked on.
    InAir,
}

/// A straight line on which nothing solid may lie.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Line {
    /// Where it begins, m.
    pub from: Vec3,
    /// Unit vector.
    pub direction: Vec3,
    /// m; 0 between equal places.
    pub length: f32,
}

/// Map and movers around a body.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Place<'a> {
    pub map: &'a Map,
    pub movers: &'a Movers,
    pub profile: &'a CharacterProfile,
}

impl Arrival {
    /// Whether a body has arrived within `radius` metres of `goal`, m.
    pub(crate) fn is_met(self, at: Place<'_>, body: &Body, goal: Vec3, radius: f32) -> bool {
        body.feet.distance(goal) <= radius
            && match self {
                Self::Touch => true,
                Self::Pass => at.is_open(body.feet, goal),
                Self::Stand => body.is_grounded() && at.walks_straight(body.feet, goal),
            }
    }
}

/// [`Arrival::Stand`] for games, which cast rays at levels of their own: the body has arrived if nothing solid lies on
/// these lines. `None`: it has not arrived, because it is in the air, its feet are more than `radius` metres from
/// `goal`, m, or steps and slopes would not take it to the goal's height.
pub fn lines_to_goal(profile: &CharacterProfile, body: &Body, goal: Vec3, radius: f32) -> Option<[Line; LINE_COUNT]> {
    let offset = goal - body.feet;
    let rise = step(profile) + horizontal(offset) * libm::tanf(profile.max_slope);
    let is_near = offset.length() <= radius && offset.y.abs() <= rise.max(LIFT_M);
    (is_near && body.is_grounded()).then(|| lines(profile, body.feet, goal))
}

/// The most that continuous ground rises in a stride besides its slope, m.
fn step(profile: &CharacterProfile) -> f32 {
    (profile.step_height + RISE_SLACK_M).max(LEAST_RISE_M)
}

/// The lines between bodies at two places.
fn lines(profile: &CharacterProfile, from: Vec3, to: Vec3) -> [Line; LINE_COUNT] {
    let offset = to - from;
    let length = offset.length();
    let (direction, length) = if length < f32::EPSILON { (Vec3::Y, 0.0) } else { (offset / length, length) };
    OPEN_AT.map(|share| Line { from: from + Vec3::Y * (share * profile.least_height()), direction, length })
}

/// Whether a body could walk straight from one place on a map to another, m. Movers do not count.
pub fn walks_straight(map: &Map, profile: &CharacterProfile, from: Vec3, to: Vec3) -> bool {
    Place { map, movers: &Movers::default(), profile }.walks_straight(from, to)
}

/// Whether something solid rises by half of the body's height above two places on a map, m, between them.
pub fn is_walled(map: &Map, profile: &CharacterProfile, from: Vec3, to: Vec3) -> bool {
    !is_open_at(map, from, to, from.y.max(to.y) + 0.5 * profile.least_height())
}

/// Whether nothing solid lies between two places at a height, m.
fn is_open_at(map: &Map, from: Vec3, to: Vec3, height: f32) -> bool {
    let (from, to) = (from.with_y(height), to.with_y(height));
    let hit = map.mesh().cast_ray(from, (to - from).normalize_or_zero(), from.distance(to));
    hit.is_none_or(|hit| !hit.surface.is_solid())
}

/// Like [`walks_straight`], but only over ground without stairs, steep slopes and gaps, on which no body stumbles.
pub fn is_plain(map: &Map, profile: &CharacterProfile, from: Vec3, to: Vec3) -> bool {
    let place = Place { map, movers: &Movers::default(), profile };
    place.is_open(from, to) && place.has_ground_within(from, to, profile.step_height)
}

/// Whether a body could walk straight from one place on a map to another, m, with room on both sides, over dry ground
/// without devices, and out of the reach of movers. Except near its ends, the lane has `margin` metres more room on
/// both sides.
pub fn is_lane(map: &Map, profile: &CharacterProfile, [from, to]: [Vec3; 2], margin: f32) -> bool {
    let place = Place { map, movers: &Movers::default(), profile };
    let ahead = (to - from).with_y(0.0).normalize_or_zero();
    let left = Vec3::new(-ahead.z, 0.0, ahead.x);
    let is_free = |[from, to]: [Vec3; 2], aside: f32| {
        let (from, to) = (from + left * aside, to + left * aside);
        place.is_open(from, to)
            && place.has_usual_ground(from, to, place.rise(from, to), |feet| is_usual_ground(map, feet))
    };
    let near = RIM_RADII * profile.radius;
    let walk = Aabb::at(from).union(Aabb::at(to)).widened(profile.height);
    if ![0.0, near, -near].into_iter().all(|aside| is_free([from, to], aside))
        || map.movers().iter().any(|mover| mover.reach().touches(walk))
    {
        return false;
    }
    let end = ((to - from) * 0.5).clamp_length_max(near + margin);
    let line_count = (margin / STRIDE_M).ceil() as u32;
    (1..=line_count).all(|line| {
        let aside = near + margin * line as f32 / line_count as f32;
        is_free([from + end, to - end], aside) && is_free([from + end, to - end], -aside)
    })
}

/// The rims of a gap or ledge.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rims {
    /// The last place before it to which a body could walk, m.
    pub take_off: Vec3,
    /// The first place behind it from which a body could walk on, m.
    pub landing: Vec3,
    /// How far a body could walk back from the take-off, away from the landing, m: at most [`RUN_UP_M`].
    pub run_up_m: f32,
}

/// Longest run-up before a gap, m.
pub const RUN_UP_M: f32 = 5.0;

/// The rims of the only gap or ledge on the straight way from one place on a map to another. `None` if the body could
/// walk all the way, and if what lies between is higher than a jump.
pub fn rims(map: &Map, profile: &CharacterProfile, [from, to]: [Vec3; 2]) -> Option<Rims> {
    let place = Place { map, movers: &Movers::default(), profile };
    let offset = (to - from).with_y(0.0);
    let ahead = offset.normalize_or_zero();
    let ((_, near), (_, far)) = (place.walkable(from, offset), place.walkable(to, -offset));
    let (take_off, landing) = (place.rim(near, ahead), place.rim(far, -ahead));
    let width = (landing - take_off).dot(ahead);
    let top = take_off.y.max(landing.y) + 0.5 * profile.least_height();
    let heights = [top, top + profile.jump_height()];
    let is_open = || heights.into_iter().any(|height| is_open_at(map, take_off, landing, height));
    (width > 0.0 && width < horizontal(offset) && is_open()).then(|| {
        let (run_up_m, _) = place.walkable(take_off, -ahead * RUN_UP_M);
        Rims { take_off, landing, run_up_m }
    })
}

/// Whether the ground at a place is dry, and no device is there.
fn is_usual_ground(map: &Map, feet: Vec3) -> bool {
    map.liquid_at(feet, 0.0).is_none() && map.device_at(feet).is_none()
}

/// The place near `at`, m, where a body has `margin` metres of room besides its radius on all sides, or as much as
/// there is; `at` itself if it has that room. The body could walk straight to the place. Walls, rims, liquids and
/// devices end the room.
pub fn with_room(map: &Map, profile: &CharacterProfile, at: Vec3, margin: f32) -> Vec3 {
    let place = Place { map, movers: &Movers::default(), profile };
    let mut feet = at;
    for _ in 0..ROOM_STEPS {
        match place.toward_room(feet, RIM_RADII * profile.radius + margin) {
            Some(step) => feet = step,
            None => break,
        }
    }
    if place.walks_straight(at, feet) { feet } else { at }
}

/// Number of strides of a walk.
fn stride_count(from: Vec3, to: Vec3) -> f32 {
    (horizontal(to - from) / STRIDE_M).ceil().max(1.0)
}

impl Place<'_> {
    fn walks_straight(self, from: Vec3, to: Vec3) -> bool {
        self.is_open(from, to) && self.has_ground(from, to)
    }

    /// The place to stand that is nearest to `goal`, at most `snap` metres away: the goal itself if a body can stand
    /// there, a place below or above it if there is one, otherwise one beside it on the same side of walls.
    pub(crate) fn footing(self, goal: Vec3, snap: f32, scratch: &mut MoveScratch) -> Result<Vec3, NoFooting> {
        let below = self.footing_at(goal, snap, scratch).map(|place| (place, place.distance(goal)));
        match below {
            Some((_, distance)) if distance <= SLACK_M => return Ok(goal),
            Some((place, distance)) if distance <= snap => return Ok(place),
            _ => {}
        }
        let is_solid = self.map.mesh().solid_depth_at(goal + Vec3::Y * (0.5 * self.profile.least_height())) > 0;
        let mut nearest: Option<Vec3> = None;
        for step in 1..=(snap / SNAP_STEP_M) as u32 {
            for spoke in 0..SNAP_SPOKES {
                let angle = std::f32::consts::TAU * f32::from(spoke) / f32::from(SNAP_SPOKES);
                let (sin, cos) = libm::sincosf(angle);
                let beside = goal + Vec3::new(cos, 0.0, sin) * (step as f32 * SNAP_STEP_M);
                let is_nearer = |place: &Vec3| {
                    let distance = place.distance(goal);
                    distance <= snap && nearest.is_none_or(|other| distance < other.distance(goal))
                };
                let place = self.footing_at(beside, snap, scratch).filter(is_nearer);
                nearest = place.filter(|place| is_solid || self.is_open(goal, *place)).or(nearest);
            }
        }
        let is_blocked = is_solid || self.ground_below(goal + Vec3::Y * ABOVE_M[0], snap).is_some();
        nearest.ok_or(if is_blocked { NoFooting::InSolid } else { NoFooting::InAir })
    }

    /// The place to stand right below a point, or a little above it.
    pub(crate) fn footing_at(self, point: Vec3, most: f32, scratch: &mut MoveScratch) -> Option<Vec3> {
        let extent = self.map.extent();
        if !(0.0..extent.x).contains(&point.x) || !(0.0..extent.z).contains(&point.z) {
            return None;
        }
        ABOVE_M.iter().find_map(|above| {
            let from = point + Vec3::Y * above;
            let place = from - Vec3::Y * self.ground_below(from, above + most)?;
            let feet = place + Vec3::Y * (0.5 * SLACK_M);
            let stands = self.is_level(place)
                && is_clear(self.map.mesh(), self.profile, feet, 0.02, scratch)
                && self.map.mesh().solid_depth_at(feet + Vec3::Y * (0.5 * self.profile.least_height())) == 0
                && self.map.liquid_at(place, 0.0) != Some(Liquid::Lava);
            stands.then_some(place)
        })
    }

    /// Whether the ground at a place is not too steep to stand on. Movers are level.
    fn is_level(self, place: Vec3) -> bool {
        let hit = self.map.mesh().cast_ray(place + Vec3::Y * 0.1, DOWN, 0.2).filter(|hit| hit.surface.is_solid());
        let normal = |triangle: u32| self.map.mesh().triangles()[triangle as usize].normal();
        hit.is_none_or(|hit| normal(hit.triangle_idx).y >= libm::cosf(self.profile.max_slope))
    }

    /// The place to stand at a horizontal offset from another, m, to which a body could walk straight. There is none
    /// at devices, in liquids, and where the body would stand over a rim.
    pub(crate) fn beside(self, from: Vec3, offset: Vec3, scratch: &mut MoveScratch) -> Option<Vec3> {
        let most = self.profile.step_height + horizontal(offset) * libm::tanf(self.profile.max_slope);
        let above = from + offset + Vec3::Y * most;
        let place = above.with_y(above.y - self.ground_below(above, 2.0 * most)?);
        let has_rim = (0..6u8).any(|spoke| {
            let (sin, cos) = libm::sincosf(f32::from(spoke) * std::f32::consts::FRAC_PI_3);
            let rim = place + Vec3::new(cos, 0.0, sin) * (RIM_RADII * self.profile.radius);
            !self.has_ground(place, rim)
        });
        // A capsule on a slope touches beside its lowest point.
        let feet = place + Vec3::Y * (SLACK_M * 0.5);
        let stands = !has_rim
            && self.walks_straight(from, place)
            && is_clear(self.map.mesh(), self.profile, feet, 0.02, scratch)
            && self.map.liquid_at(place, -0.1).is_none()
            && self.map.device_at(place).is_none();
        stands.then_some(place)
    }

    /// The next place on the way to `room` metres of room on all sides of a place, away from what is nearest there.
    /// `None` if there is no better place.
    fn toward_room(self, feet: Vec3, room: f32) -> Option<Vec3> {
        let spoke = |idx: u8| {
            let (sin, cos) = libm::sincosf(std::f32::consts::TAU * f32::from(idx) / f32::from(SNAP_SPOKES));
            Vec3::new(cos, 0.0, sin)
        };
        let free: Vec<f32> = (0..SNAP_SPOKES).map(|idx| self.walkable(feet, spoke(idx) * room).0).collect();
        let opposite = |idx: u8| usize::from((idx + SNAP_SPOKES / 2) % SNAP_SPOKES);
        let step = |idx: u8| 0.5 * (free[usize::from(idx)] - free[opposite(idx)]);
        let widest = (0..SNAP_SPOKES).max_by(|a, b| step(*a).total_cmp(&step(*b)))?;
        let (length, way) = (step(widest), spoke(widest));
        (length >= LEAST_STEP_M).then(|| self.walkable(feet, way * length).1)
    }

    /// How far a body could walk from a place along `offset`, m, over dry ground without devices, and where it is then.
    pub(crate) fn walkable(self, from: Vec3, offset: Vec3) -> (f32, Vec3) {
        let stride_count = stride_count(from, from + offset);
        let (stride, rise) = (offset / stride_count, self.rise(from, from + offset));
        let mut feet = from;
        for idx in 0..stride_count as u32 {
            let walked = idx as f32 * stride.length();
            let above = feet + stride + Vec3::Y * rise;
            let Some(depth) = self.ground_below(above, 2.0 * rise) else { return (walked, feet) };
            let next = above - Vec3::Y * depth;
            let hits = lines(self.profile, feet, next).into_iter().filter_map(|line| {
                let hit = self.map.mesh().cast_ray(line.from, line.direction, line.length)?;
                hit.surface.is_solid().then_some(hit.distance)
            });
            if let Some(hit) = hits.min_by(f32::total_cmp) {
                return (walked + hit, feet);
            }
            if !is_usual_ground(self.map, next) {
                return (walked, feet);
            }
            feet = next;
        }
        (offset.length(), feet)
    }

    /// Where the ground ends within a stride from a place, to about 2 cm; the place itself if it goes on.
    fn rim(self, feet: Vec3, ahead: Vec3) -> Vec3 {
        let rise = step(self.profile);
        let ground = |along: f32| {
            let above = feet + ahead * along + Vec3::Y * rise;
            Some(above - Vec3::Y * self.ground_below(above, 2.0 * rise)?)
        };
        if ground(STRIDE_M).is_some() {
            return feet;
        }
        let (mut rim, mut low, mut high) = (feet, 0.0, STRIDE_M);
        for _ in 0..RIM_BISECTIONS {
            let middle = 0.5 * (low + high);
            match ground(middle) {
                Some(place) => (rim, low) = (place, middle),
                None => high = middle,
            }
        }
        rim
    }

    /// Whether nothing solid lies between bodies at two places.
    fn is_open(self, from: Vec3, to: Vec3) -> bool {
        lines(self.profile, from, to).into_iter().filter(|line| line.length > 0.0).all(|line| {
            let Line { from, direction, length } = line;
            let hit = self.map.mesh().cast_ray(from, direction, length);
            hit.is_none_or(|hit| !hit.surface.is_solid()) && self.movers.cast_ray(from, direction, length).is_none()
        })
    }

    /// Whether the ground on the straight way between two places is nowhere too steep, and is continuous.
    fn has_ground(self, from: Vec3, to: Vec3) -> bool {
        self.has_ground_within(from, to, self.rise(from, to))
    }

    /// The most that ground which is not too steep rises in a stride between two places, m.
    fn rise(self, from: Vec3, to: Vec3) -> f32 {
        let slope = horizontal(to - from) / stride_count(from, to) * libm::tanf(self.profile.max_slope);
        step(self.profile) + slope
    }

    /// Whether the ground on the straight way between two places rises or drops by at most `rise` metres in a stride.
    fn has_ground_within(self, from: Vec3, to: Vec3, rise: f32) -> bool {
        self.has_usual_ground(from, to, rise, |_| true)
    }

    /// Like [`has_ground_within`](Self::has_ground_within), where the ground at the end of each stride also
    /// `is_usual`.
    fn has_usual_ground(self, from: Vec3, to: Vec3, rise: f32, is_usual: impl Fn(Vec3) -> bool) -> bool {
        let offset = to - from;
        let stride_count = stride_count(from, to);
        let mut height = from.y;
        for stride in 1..=stride_count as u32 {
            let above = (from + offset * (stride as f32 / stride_count)).with_y(height + rise);
            let Some(depth) = self.ground_below(above, 2.0 * rise) else { return false };
            height = above.y - depth;
            if !is_usual(above.with_y(height)) {
                return false;
            }
        }
        (to.y - height).abs() <= rise
    }

    /// Depth of the ground below a point, m, at most `most`.
    fn ground_below(self, above: Vec3, most: f32) -> Option<f32> {
        let (mut built, mut searched) = (None, 0.0);
        for _ in 0..MAX_FACES {
            let Some(hit) = self.map.mesh().cast_ray(above + DOWN * searched, DOWN, most - searched) else { break };
            searched += hit.distance;
            if hit.surface.is_solid() {
                built = Some(searched);
                break;
            }
            searched += 0.001;
        }
        let moving = self.movers.cast_ray(above, DOWN, most);
        built.into_iter().chain(moving).min_by(f32::total_cmp)
    }
}
