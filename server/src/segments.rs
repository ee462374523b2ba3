//! The motion of a world's bodies as straight segments, for one reader.
//!
//! A segment joins two positions of a body, which are rounded to a grid. A segment grows tick by tick while the body
//! was never farther than [`BOUND_M`] from the segment; otherwise it ends. Drawn positions therefore keep the bound,
//! rounding included. The next segment of the body starts where the last one ended. Between them the body stands there.
//!
//! The fit runs in the reader's task. The world's thread only copies the poses of every tick. Start at [`Fit::follow`].

use crate::hosted::{BodyId, BodyPose, Poses};
use crate::view::Region;
use std::collections::BTreeMap;
use std::f32::consts::TAU;
use surefoot_world::{Tick, Vec3};

/// Length of a step of the grid, m.
pub const STEP_M: f64 = 0.01;
/// Greatest distance between a drawn position and the true one, m: 5 cm less the rounding of clients.
const BOUND_M: f32 = 0.0495;
/// A body within this distance of the end of its last segment has not moved, m. A body that sways on a border of the
/// grid therefore costs nothing.
const REST_M: f32 = 0.01;
/// Ticks at rest after which a body that sets out begins a segment. Even slow walkers leave their place in fewer.
const REST_TICKS: usize = 3;
/// A body that moves farther than this within a tick counts as teleported, m: 60 m/s.
const JUMP_M: f32 = 1.0;
/// Number of headings in a full turn.
const HEADINGS: f32 = 256.0;
/// Most ticks between two messages.
const QUIET_TICKS: u64 = 60;

/// A pose on the grid.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct GridPose {
    /// Position of the feet, in steps.
    steps: [i32; 3],
    /// Heading in 1/256 of a turn.
    pub heading: u8,
}

impl GridPose {
    fn of(pose: &BodyPose) -> Self {
        let steps = pose.feet.to_array().map(|value| (f64::from(value) / STEP_M).round() as i32);
        // Truncation to 8 bits removes whole turns.
        Self { steps, heading: (pose.yaw / TAU * HEADINGS).round() as i32 as u8 }
    }

    /// Position of the feet, m.
    pub fn place(self) -> Vec3 {
        Vec3::from_array(self.steps.map(|steps| (f64::from(steps) * STEP_M) as f32))
    }

    /// Change from this heading to the heading of `other`, in the shorter direction, 1/256 of a turn.
    fn turn_to(self, other: Self) -> i32 {
        i32::from(other.heading.wrapping_sub(self.heading).cast_signed())
    }

    /// The pose after this one. Position and heading change only if the body has moved or turned.
    fn next(self, pose: &BodyPose) -> Self {
        let next = Self::of(pose);
        let rests = self.place().distance(pose.feet) <= REST_M;
        let faces_same = self.turn_to(next).abs() <= 1;
        Self {
            steps: if rests { self.steps } else { next.steps },
            heading: if faces_same { self.heading } else { next.heading },
        }
    }
}

/// Where the segments of a body begin.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Start {
    /// Number of the body for this reader.
    pub body: u32,
    pub id: BodyId,
    pub at: GridPose,
}

/// A motion in a straight line at one speed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Segment {
    /// Number of the body for this reader.
    pub body: u32,
    pub ticks: u32,
    /// Displacement from start to end, in steps.
    pub steps: [i32; 3],
    /// Change of the heading, 1/256 of a turn.
    pub turn: i32,
}

/// What a reader has to learn at a tick: the content of one message.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct News {
    pub tick: Tick,
    /// Whether the reader must forget all bodies.
    pub restarts: bool,
    /// Bodies that were removed or left the region.
    pub gone: Vec<u32>,
    /// Segments that ended at the tick before.
    pub segments: Vec<Segment>,
    /// Bodies whose segments begin at this tick.
    pub starts: Vec<Start>,
}

/// Fits segments to the poses of the bodies in a reader's view.
#[derive(Debug)]
pub struct Fit {
    region: Option<Region>,
    max_ticks: usize,
    /// Bodies in the reader's view at the last tick.
    tracks: BTreeMap<BodyId, Track>,
    /// Number of the next new body.
    next_body: u32,
    /// Tick of the last message; `None` if the next one restarts.
    sent: Option<Tick>,
}

impl Fit {
    /// Creates a fit for the NPCs in `region` (`None`: everywhere) and all players. Segments last at most `max_ticks`.
    pub fn new(region: Option<Region>, max_ticks: usize) -> Self {
        Self { region, max_ticks, tracks: BTreeMap::new(), next_body: 0, sent: None }
    }

    /// Starts again with the next poses. Ticks may be missing before them.
    pub fn restart(&mut self) {
        *self = Self::new(self.region, self.max_ticks);
    }

    /// Takes the poses of the next tick. Returns `None` if no message is due.
    pub fn follow(&mut self, poses: &Poses) -> Option<News> {
        let tick = poses.tick;
        let mut news =
            News { tick, restarts: self.sent.is_none(), gone: Vec::new(), segments: Vec::new(), starts: Vec::new() };
        let region = self.region;
        let is_shown = |pose: &&BodyPose| match pose.id {
            BodyId::Npc(_) => region.is_none_or(|region| region.holds(pose.feet)),
            BodyId::Player(_) => true,
        };
        for pose in poses.bodies.iter().filter(is_shown) {
            match self.tracks.get_mut(&pose.id) {
                Some(track) => track.follow(pose, tick, self.max_ticks, &mut news),
                None => {
                    let track = Track::new(self.next_body, pose, tick, &mut news);
                    self.tracks.insert(pose.id, track);
                    self.next_body += 1;
                }
            }
        }
        self.tracks.retain(|_, track| {
            let is_there = track.seen == tick;
            if !is_there {
                news.segments.extend(track.close());
                news.gone.push(track.body);
            }
            is_there
        });
        let is_quiet = news.gone.is_empty() && news.segments.is_empty() && news.starts.is_empty();
        let is_due = self.sent.is_none_or(|sent| !is_quiet || tick.since(sent) >= QUIET_TICKS);
        if is_due {
            self.sent = Some(tick);
        }
        is_due.then_some(news)
    }
}

/// The motion of a body since its last segment.
#[derive(Debug)]
struct Track {
    /// Number of the body for this reader.
    body: u32,
    /// Last tick at which the body was in the view.
    seen: Tick,
    /// Position of the feet at that tick, m.
    feet: Vec3,
    /// Where the open segment starts.
    start: GridPose,
    /// Where it would end at the last tick.
    end: GridPose,
    /// Positions of the feet since its start, one for each tick, m.
    places: Vec<Vec3>,
}

impl Track {
    fn new(body: u32, pose: &BodyPose, tick: Tick, news: &mut News) -> Self {
        let at = GridPose::of(pose);
        news.starts.push(Start { body, id: pose.id, at });
        Self { body, seen: tick, feet: pose.feet, start: at, end: at, places: Vec::new() }
    }

    /// Takes the pose of the next tick.
    fn follow(&mut self, pose: &BodyPose, tick: Tick, max_ticks: usize, news: &mut News) {
        if self.feet.distance(pose.feet) > JUMP_M {
            news.segments.extend(self.close());
            *self = Self::new(self.body, pose, tick, news);
            return;
        }
        let end = self.start.next(pose);
        let sets_out = self.places.len() >= REST_TICKS && self.end == self.start && end != self.start;
        if sets_out || self.places.len() == max_ticks || !self.fits(end) {
            news.segments.extend(self.close());
        }
        self.end = self.start.next(pose);
        self.places.push(pose.feet);
        (self.seen, self.feet) = (tick, pose.feet);
    }

    /// Whether the open segment keeps the bound if it grows by a tick and ends at `end`.
    fn fits(&self, end: GridPose) -> bool {
        let start = self.start.place();
        let by_tick = (end.place() - start) / (self.places.len() + 1) as f32;
        let drawn = (1..).map(|ticks| start + by_tick * ticks as f32);
        self.places.iter().zip(drawn).all(|(place, drawn)| place.distance_squared(drawn) <= BOUND_M * BOUND_M)
    }

    /// Ends the open segment and starts the next one at its end. Returns `None` if the body has stood still.
    fn close(&mut self) -> Option<Segment> {
        let (start, end) = (self.start, self.end);
        let ticks = self.places.len() as u32;
        self.start = end;
        self.places.clear();
        let steps = std::array::from_fn(|axis| end.steps[axis] - start.steps[axis]);
        (start != end).then(|| Segment { body: self.body, ticks, steps, turn: start.turn_to(end) })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ids::NpcId;
    use crate::wire::news_to_wire;
    use proptest::prelude::*;
    use surefoot_proto::segments::DrawnWorld;
    use surefoot_world::PlayerSlot;

    const NPC: BodyId = BodyId::Npc(NpcId(7));

    fn pose(feet: Vec3) -> BodyPose {
        BodyPose { id: NPC, feet, yaw: 0.0 }
    }

    /// The messages of a fit for an NPC that is at these positions at ticks 0, 1, 2 and so on.
    fn news_of(max_ticks: usize, places: &[Vec3]) -> Vec<News> {
        let mut fit = Fit::new(None, max_ticks);
        let ticks = places.iter().enumerate();
        ticks
            .filter_map(|(tick, feet)| fit.follow(&Poses { tick: Tick(tick as u64), bodies: vec![pose(*feet)] }))
            .collect()
    }

    fn walk() -> impl Strategy<Value = Vec<Vec3>> {
        // Velocities, m/s, each for some ticks, and teleports.
        let leg = (prop::array::uniform3(-12.0_f32..12.0), 1..40_usize, prop::bool::weighted(0.3));
        prop::collection::vec(leg, 1..12).prop_map(|legs| {
            let mut feet = Vec3::new(900.0, 20.0, 1100.0);
            let mut places = vec![feet];
            for (velocity, ticks, rests) in legs {
                let velocity = if rests { Vec3::ZERO } else { Vec3::from_array(velocity) };
                feet += if velocity.x > 11.0 { 5.0 * Vec3::X } else { Vec3::ZERO };
                for _ in 0..ticks {
                    feet += velocity / 60.0;
                    places.push(feet);
                }
            }
            places
        })
    }

    proptest! {
        #[test]
        fn a_client_draws_every_tick_within_the_bound(places in walk(), max_ticks in 6..=60_usize) {
            let known = places.len().saturating_sub(max_ticks + 1);
            let news = news_of(max_ticks, &places);
            let mut world = DrawnWorld::default();
            news.iter().for_each(|news| world.take(&news_to_wire(news)));
            for (tick, place) in places.iter().enumerate().take(known) {
                let drawn = world.at(tick as u64).next().unwrap().position.map(|value| value as f32);
                prop_assert!(place.distance(drawn.into()) <= 0.05, "{drawn:?} is drawn for {place} at tick {tick}");
            }
            let longest = news.iter().flat_map(|news| &news.segments).map(|segment| segment.ticks).max();
            prop_assert!(longest.is_none_or(|ticks| (1..=max_ticks as u32).contains(&ticks)));
        }
    }

    #[test]
    fn a_straight_run_costs_one_segment_in_the_longest_time() {
        let places: Vec<Vec3> = (0..92).map(|tick| Vec3::new(0.1 * tick as f32, 1.0, 5.0)).collect();
        let news = news_of(30, &places);
        let segments: Vec<(u64, Segment)> =
            news.iter().flat_map(|news| news.segments.iter().map(|segment| (news.tick.0, *segment))).collect();
        let segment = Segment { body: 0, ticks: 30, steps: [300, 0, 0], turn: 0 };
        assert_eq!(segments, [(31, segment), (61, segment), (91, segment)]);
    }

    #[test]
    fn a_body_at_rest_costs_a_message_in_a_second_until_it_moves_or_turns() {
        let sways = |tick: u64| Vec3::new(3.0049 + 0.004 * (tick % 2) as f32, 0.0, 0.0);
        let mut fit = Fit::new(None, 30);
        let mut sent = Vec::new();
        for tick in 0..200 {
            let yaw = if tick < 190 { 0.0 } else { 1.0 };
            let bodies = vec![BodyPose { yaw, ..pose(sways(tick)) }];
            sent.extend(fit.follow(&Poses { tick: Tick(tick), bodies }));
        }
        assert!(sent.iter().map(|news| news.tick.0).eq([0, 60, 120, 180]), "{sent:?}");
        assert!(sent[0].restarts && sent[0].starts.len() == 1);
        assert!(sent[1..].iter().all(|news| !news.restarts && news.segments.is_empty() && news.starts.is_empty()));
        // The turn begins a segment.
        let later = (200..240).find_map(|tick| {
            let bodies = vec![BodyPose { yaw: 1.0, ..pose(sways(tick)) }];
            fit.follow(&Poses { tick: Tick(tick), bodies })
        });
        let segment = Segment { body: 0, ticks: 30, steps: [0; 3], turn: 41 };
        let later = later.unwrap();
        assert_eq!((later.tick, later.segments), (Tick(220), vec![segment]));
    }

    #[test]
    fn jumps_start_again_and_what_leaves_the_view_is_gone_after_its_last_segment() {
        let region = Region { low: Vec3::splat(-10.0), high: Vec3::splat(10.0) };
        let mut fit = Fit::new(Some(region), 30);
        let player = BodyPose { id: BodyId::Player(PlayerSlot(2)), ..pose(Vec3::splat(50.0)) };
        let mut at = |tick, feet: Option<Vec3>| {
            let bodies = feet.map(pose).into_iter().chain([player]).collect();
            fit.follow(&Poses { tick: Tick(tick), bodies })
        };
        let first = at(0, Some(Vec3::ZERO)).unwrap();
        let who: Vec<(u32, BodyId)> = first.starts.iter().map(|start| (start.body, start.id)).collect();
        assert_eq!(who, [(0, NPC), (1, player.id)], "players are shown everywhere");
        assert_eq!(at(1, Some(0.1 * Vec3::X)), None);
        let jumped = at(2, Some(3.0 * Vec3::X)).unwrap();
        let stride = |steps| Segment { body: 0, ticks: 1, steps, turn: 0 };
        assert_eq!(jumped.segments, [stride([10, 0, 0])]);
        assert_eq!((jumped.starts[0].body, jumped.starts[0].at.place()), (0, 3.0 * Vec3::X));
        assert_eq!(at(3, Some(3.1 * Vec3::X)), None);
        let left = at(4, Some(20.0 * Vec3::X)).unwrap();
        assert_eq!((left.segments, left.gone), (vec![stride([10, 0, 0])], vec![0]));
        let back = at(5, Some(Vec3::ZERO)).unwrap();
        assert_eq!((back.starts[0].body, back.starts[0].id), (2, NPC));
        assert_eq!(at(6, None).unwrap().gone, [2]);

        // The reader has missed ticks.
        fit.restart();
        let again = fit.follow(&Poses { tick: Tick(90), bodies: vec![pose(Vec3::X), player] }).unwrap();
        assert!(again.restarts && again.starts.iter().map(|start| start.body).eq([0, 1]), "{again:?}");
    }
}
