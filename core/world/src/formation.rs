//! Formations: where the NPCs of a group go while their leader is under way.
//!
//! Places are counted from the way that the leader has come, on which a body can walk: so many metres back, and so many
//! to the side. Where there is no room at the side, as in a corridor, an NPC falls in behind the leader, and it opens
//! up again where there is.

use crate::float::horizontal;
use crate::{NpcSlot, Vec3, World};
use serde::{Deserialize, Serialize};
use std::collections::VecDeque;
use std::f32::consts::{FRAC_PI_2, PI};

/// Distance between two points of the leader's way that are kept, m.
const STRIDE_M: f32 = 0.5;
/// Length of the way from which the direction of the formation is taken, m.
const DIRECTION_M: f32 = 2.0;
/// Updates in a row with room at the side after which an NPC opens up again.
const OPEN_AFTER: u8 = 3;

/// Spacings, with a part for small ones, m, by which a follower lags behind its place when the leader waits for it, and
/// up to which the leader goes on.
const WAITS_AT: (f32, f32) = (1.0, 1.0);
const GOES_ON_AT: (f32, f32) = (0.5, 0.5);
/// Longest wait of a leader, and least time from one wait to the next, decisions: one follower that is stuck does not
/// stop the group.
const LONGEST_WAIT: u32 = 30;
const LEAST_WALK: u32 = 6;
/// Greatest speed of a leader, as a share of its body's: its followers must be able to catch up.
pub const LEADER_SPEED: f32 = 0.8;
/// Time in which a leader comes to rest, s.
const BRAKING_S: f32 = 0.4;

/// How the NPCs of a group stand to each other.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum Shape {
    /// One behind the other.
    Column,
    /// Side by side, the leader in the middle.
    Line,
    /// Two lines that trail behind the leader to both sides.
    Wedge,
    /// Scattered behind the leader.
    Loose,
}

impl Shape {
    /// Distances of a follower from its leader, in spacings: to the right and back.
    fn place(self, follower: usize) -> (f32, f32) {
        let (pair, side) = ((follower / 2 + 1) as f32, if follower.is_multiple_of(2) { 1.0 } else { -1.0 });
        match self {
            Self::Column => (0.0, (follower + 1) as f32),
            Self::Line => (side * pair, 0.0),
            Self::Wedge => (side * pair, pair),
            Self::Loose => {
                /// The golden ratio less one: angles that it divides are spread evenly.
                const GOLDEN: f32 = 0.618_034;
                let angle = PI * ((follower + 1) as f32 * GOLDEN).fract() - FRAC_PI_2;
                let (sin, cos) = libm::sincosf(angle);
                let distance = (1.5 * (follower + 1) as f32 + 0.5).sqrt();
                (distance * sin, distance * cos)
            }
        }
    }
}

/// A group under way.
#[derive(Debug, Clone)]
pub struct Formation {
    shape: Shape,
    spacing: f32,
    /// Where the leader was on the ground, m, the latest place first.
    trail: VecDeque<Vec3>,
    /// Where the leader goes, horizontal and of length 1, before its way says so.
    heading: Vec3,
    /// Of each follower: updates in a row with room for its place.
    open: Vec<u8>,
    /// Whether the leader waits, and for how many updates it has waited or walked.
    waits: (bool, u32),
}

/// What the NPCs of a group do next.
#[derive(Debug, Clone, PartialEq)]
pub struct Orders {
    /// Where each follower should be now, m; `None`: where it is.
    pub places: Vec<Option<Vec3>>,
    /// Whether the leader waits for the others.
    pub leader_waits: bool,
}

/// A place on the leader's way, and the direction of the way there.
#[derive(Debug, Clone, Copy)]
struct Anchor {
    at: Vec3,
    heading: Vec3,
}

impl Anchor {
    /// The offset of a place so far to the right and back, m.
    fn offset(self, right: f32, back: f32) -> Vec3 {
        Vec3::new(-self.heading.z, 0.0, self.heading.x) * right - self.heading * back
    }
}

impl Formation {
    /// A group whose leader sets out from `feet` to `goal`, m; neighbours are `spacing` metres apart.
    pub fn new(shape: Shape, spacing: f32, feet: Vec3, goal: Vec3) -> Self {
        let heading = direction(feet, goal).unwrap_or(Vec3::Z);
        Self { shape, spacing, trail: VecDeque::from([feet]), heading, open: Vec::new(), waits: (false, LEAST_WALK) }
    }

    /// The shape and the spacing, m.
    pub fn layout(&self) -> (Shape, f32) {
        (self.shape, self.spacing)
    }

    /// Heading of the leader's latest way, horizontal and of length 1.
    pub fn heading(&self) -> Vec3 {
        self.anchor(0.0).map_or(self.heading, |anchor| anchor.heading)
    }

    /// Follows the leader, once in each of its decisions.
    pub fn update(&mut self, world: &World, leader: NpcSlot, followers: &[NpcSlot]) -> Orders {
        self.follow(world, leader, followers.len());
        self.open.resize(followers.len(), OPEN_AFTER);
        let places = followers.iter().enumerate().map(|(idx, slot)| {
            let (right, back) = self.shape.place(idx);
            let anchor = self.anchor(back * self.spacing);
            let offset = |anchor: Anchor| anchor.offset(right * self.spacing, 0.0);
            let place = anchor.and_then(|anchor| match right {
                0.0 => Some(anchor.at),
                _ => world.place_beside(*slot, anchor.at, offset(anchor)),
            });
            self.open[idx] = if place.is_some() { (self.open[idx] + 1).min(OPEN_AFTER) } else { 0 };
            let behind = || Some(self.anchor((idx + 1) as f32 * self.spacing)?.at);
            place.filter(|_| self.open[idx] == OPEN_AFTER).or_else(behind)
        });
        let places: Vec<Option<Vec3>> = places.collect();
        let feet = |slot: NpcSlot| world.npc(slot).map(|npc| npc.body.feet);
        let lags = followers.iter().zip(&places).filter_map(|(slot, place)| Some(feet(*slot)?.distance((*place)?)));
        let leader_waits = self.waits_for(lags.fold(0.0, f32::max), self.can_brake(world, leader));
        Orders { places, leader_waits }
    }

    /// Whether the leader waits for a follower that lags `lag` metres behind its place.
    fn waits_for(&mut self, lag: f32, can_brake: bool) -> bool {
        let limit = |(spacings, metres): (f32, f32)| spacings * self.spacing + metres;
        let (waits, lasted) = self.waits;
        let changes = match waits {
            true => lag <= limit(GOES_ON_AT) || lasted >= LONGEST_WAIT,
            false => lag > limit(WAITS_AT) && lasted >= LEAST_WALK && can_brake,
        };
        self.waits = if changes { (!waits, 0) } else { (waits, lasted + 1) };
        self.waits.0
    }

    /// Whether the leader can come to rest: on the ground, not on a mover, and not at a rim.
    fn can_brake(&self, world: &World, leader: NpcSlot) -> bool {
        let body = world.npc(leader).map(|npc| npc.body).filter(|body| body.is_grounded() && !body.is_carried());
        body.is_some_and(|body| world.place_beside(leader, body.feet, body.velocity.with_y(0.0) * BRAKING_S).is_some())
    }

    /// Where the followers stand once the leader has arrived at `goal`, m, and faces `heading`: `None` if there is no
    /// room for that place.
    pub fn places_at(&self, world: &World, followers: &[NpcSlot], goal: Vec3, heading: Vec3) -> Vec<Option<Vec3>> {
        let anchor = Anchor { at: goal, heading };
        let place = |(idx, slot): (usize, &NpcSlot)| {
            let (right, back) = self.shape.place(idx);
            world.place_beside(*slot, goal, anchor.offset(right * self.spacing, back * self.spacing))
        };
        followers.iter().enumerate().map(place).collect()
    }

    /// Adds the leader's place to its way, if it is on the ground, and forgets what no follower needs.
    fn follow(&mut self, world: &World, leader: NpcSlot, followers: usize) {
        let Some(npc) = world.npc(leader) else { return };
        let moved = self.trail.front().is_none_or(|latest| latest.distance(npc.body.feet) >= STRIDE_M);
        if moved && npc.body.is_grounded() && !npc.body.is_carried() {
            self.trail.push_front(npc.body.feet);
        }
        let longest = ((followers + 1) as f32 * self.spacing + DIRECTION_M) / STRIDE_M;
        self.trail.truncate(longest as usize + 1);
    }

    /// The first place on the leader's way that lies at least `back` metres back; `None` if the way is shorter.
    fn anchor(&self, back: f32) -> Option<Anchor> {
        let mut run = 0.0;
        let ahead_of = std::iter::once(None).chain(self.trail.iter().map(Some));
        let runs: Vec<f32> = self
            .trail
            .iter()
            .zip(ahead_of)
            .map(|(at, ahead)| {
                run += ahead.map_or(0.0, |ahead: &Vec3| ahead.distance(*at));
                run
            })
            .collect();
        let idx_at = |back: f32| runs.partition_point(|run| *run < back);
        let at = *self.trail.get(idx_at(back))?;
        let [ahead, behind] = [-0.5, 0.5].map(|share| {
            let idx = idx_at(back + share * DIRECTION_M).min(runs.len() - 1);
            self.trail[idx]
        });
        Some(Anchor { at, heading: direction(behind, ahead).unwrap_or(self.heading) })
    }
}

/// Horizontal direction from one place to another; `None` if they are above each other.
fn direction(from: Vec3, to: Vec3) -> Option<Vec3> {
    let offset = (to - from).with_y(0.0);
    (horizontal(offset) > 0.1).then(|| offset.normalize())
}
