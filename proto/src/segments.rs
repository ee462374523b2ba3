//! What a client draws of the messages of `WatchSegments`.

use crate::world::v1::segment_start::Who;
use crate::world::v1::{SegmentStart, WatchSegmentsResponse};
use std::collections::{BTreeMap, VecDeque};
use std::f64::consts::TAU;

/// Headings in a turn.
const HEADINGS: f64 = 256.0;

/// Where a body is drawn.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DrawnPose {
    /// The body.
    pub who: Who,
    /// Position of the feet, in the coordinates of the call.
    pub position: [f64; 3],
    /// Heading, rad, 0 up to a whole turn; 0 faces +z of the map, counter-clockwise seen from above.
    pub yaw: f64,
}

/// The bodies of a stream of segments.
#[derive(Debug, Clone, Default)]
pub struct DrawnWorld {
    /// Length of a step.
    step: f64,
    /// Tick from which the stream is complete.
    since: u64,
    /// Tick of the last message.
    tick: u64,
    bodies: Vec<DrawnBody>,
}

impl DrawnWorld {
    /// Tick of the last message.
    pub fn tick(&self) -> u64 {
        self.tick
    }

    /// The first tick that can be drawn: the stream restarted there, or earlier ones were
    /// [forgotten](Self::forget_before).
    pub fn since(&self) -> u64 {
        self.since
    }

    /// Applies the next message of the stream. Ignores segments of unknown bodies and incomplete rows, which servers do
    /// not send.
    pub fn take(&mut self, message: &WatchSegmentsResponse) {
        if message.restarts {
            *self = Self { step: message.step, since: message.tick, ..Self::default() };
        }
        self.tick = message.tick;
        let current = self.bodies.iter_mut().filter(|body| body.gone.is_none());
        let mut current: BTreeMap<u32, &mut DrawnBody> = current.map(|body| (body.number, body)).collect();
        let motions = message.ticks.iter().zip(message.moves.as_chunks::<3>().0).zip(&message.turns);
        for (number, ((&ticks, steps), &turn)) in message.bodies.iter().zip(motions) {
            let Some(body) = current.get_mut(number) else { continue };
            let start = message.tick.saturating_sub(1 + u64::from(ticks));
            let moved = steps.map(|steps| f64::from(steps) * self.step);
            body.pieces.push_back(Piece { start, ticks, moved, turn, ..body.end() });
        }
        for number in &message.gone {
            if let Some(body) = current.remove(number) {
                body.gone = Some(message.tick);
            }
        }
        let mut new = Vec::new();
        for start in &message.starts {
            let piece = Piece::at_rest(message.tick, start);
            match current.get_mut(&start.body) {
                Some(body) => body.pieces.push_back(piece),
                None => new.extend(DrawnBody::new(start, piece)),
            }
        }
        self.bodies.extend(new);
    }

    /// The bodies at a tick. Ticks up to `max_ticks` + 1 before [`tick`](Self::tick) are final.
    pub fn at(&self, tick: u64) -> impl Iterator<Item = DrawnPose> {
        self.bodies.iter().filter_map(move |body| body.at(tick))
    }

    /// Drops what is needed only for ticks before this one.
    pub fn forget_before(&mut self, tick: u64) {
        self.since = self.since.max(tick);
        self.bodies.retain(|body| body.gone.is_none_or(|gone| gone > tick));
        for body in &mut self.bodies {
            while body.pieces.get(1).is_some_and(|next| next.start <= tick) {
                body.pieces.pop_front();
            }
        }
    }
}

#[derive(Debug, Clone)]
struct DrawnBody {
    number: u32,
    who: Who,
    /// By their starts; at least one.
    pieces: VecDeque<Piece>,
    /// Tick from which the body is not there.
    gone: Option<u64>,
}

impl DrawnBody {
    fn new(start: &SegmentStart, piece: Piece) -> Option<Self> {
        Some(Self { number: start.body, who: start.who?, pieces: VecDeque::from([piece]), gone: None })
    }

    /// Rest at the end of the last piece.
    fn end(&self) -> Piece {
        let last = self.pieces[self.pieces.len() - 1];
        Piece { from: last.position_at(u64::MAX), heading: last.heading + f64::from(last.turn), ..last }
    }

    fn at(&self, tick: u64) -> Option<DrawnPose> {
        let piece = self.pieces.iter().rev().find(|piece| piece.start <= tick)?;
        let yaw = (piece.heading_at(tick) / HEADINGS).rem_euclid(1.0) * TAU;
        let pose = DrawnPose { who: self.who, position: piece.position_at(tick), yaw };
        self.gone.is_none_or(|gone| tick < gone).then_some(pose)
    }
}

/// A motion from a tick on, after which the body stands.
#[derive(Debug, Clone, Copy)]
struct Piece {
    start: u64,
    ticks: u32,
    from: [f64; 3],
    moved: [f64; 3],
    /// Heading at the start, and its change, 1/256 of a turn.
    heading: f64,
    turn: i32,
}

impl Piece {
    fn at_rest(tick: u64, start: &SegmentStart) -> Self {
        let position = start.position.unwrap_or_default();
        let from = [position.x, position.y, position.z].map(f64::from);
        Self { start: tick, ticks: 0, from, moved: [0.0; 3], heading: f64::from(start.heading), turn: 0 }
    }

    /// Share of the motion that is done.
    fn share_at(&self, tick: u64) -> f64 {
        let done = tick.saturating_sub(self.start).min(u64::from(self.ticks));
        done as f64 / f64::from(self.ticks.max(1))
    }

    fn position_at(&self, tick: u64) -> [f64; 3] {
        std::array::from_fn(|axis| self.from[axis] + self.share_at(tick) * self.moved[axis])
    }

    fn heading_at(&self, tick: u64) -> f64 {
        self.heading + self.share_at(tick) * f64::from(self.turn)
    }
}
