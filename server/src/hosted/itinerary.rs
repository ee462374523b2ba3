//! Routes as data: what an NPC does between the goals that clients set, and how far it has come.

use super::pursuit::Target;
use serde::{Deserialize, Serialize};
use std::ops::RangeInclusive;
use surefoot_world::arrival::RETRY_TICKS;
use surefoot_world::{End, TICKS_PER_SECOND, Tick, Vec3};

/// Numbers of stops of a patrol.
pub const STOP_COUNT: RangeInclusive<usize> = 2..=64;
/// Longest rest at a stop or a place, ticks.
pub const MAX_DWELL_TICKS: u64 = 3600 * TICKS_PER_SECOND as u64;
/// Ticks from one look at the threat to the next.
pub(super) const LOOK_TICKS: u64 = TICKS_PER_SECOND as u64 / 2;
/// Least time from one attempt of a route to the next, ticks: places may be so close that the NPC is there already.
const PERIOD_TICKS: u64 = TICKS_PER_SECOND as u64;

/// What an NPC flees from.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Threat {
    /// The body or place.
    pub from: Target,
    /// Distance that the NPC keeps, m.
    pub distance: f32,
    /// Whether the NPC also gets out of sight.
    pub hides: bool,
}

impl Threat {
    /// The place, m, if the threat is one.
    pub fn place_mut(&mut self) -> Option<&mut Vec3> {
        match &mut self.from {
            Target::Moving { from, .. } => Some(from),
            _ => None,
        }
    }
}

/// What an NPC does by itself.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub enum Route {
    /// Goes from stop to stop.
    Patrol {
        /// The stops, [`STOP_COUNT`].
        stops: Vec<Stop>,
        /// Whether it goes back through the stops instead of beginning again at the first.
        back_and_forth: bool,
    },
    /// Stays at a place.
    Hold {
        /// The place, m; `None` in orders of clients: where the NPC is.
        post: Option<Vec3>,
        /// Distance from the place beyond which the NPC returns, m.
        radius: f32,
        /// Heading to which the NPC turns there, rad.
        facing: Option<f32>,
    },
    /// Goes to places of an area at random.
    Wander {
        /// The area.
        area: Area,
        /// Rest at each place, ticks.
        dwell: u64,
    },
    /// Gets away from a threat.
    Flee(Threat),
}

/// A stop of a patrol.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Stop {
    /// The place, m.
    pub at: Vec3,
    /// Rest there, ticks.
    pub dwell: u64,
    /// Distance within which the NPC arrives, m.
    pub radius: f32,
    /// Heading to which the NPC turns there, rad.
    pub facing: Option<f32>,
}

/// An area in which an NPC wanders.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub enum Area {
    /// A zone of the world, by its name.
    Zone(String),
    /// The ground around a place.
    Circle {
        /// The place, m.
        centre: Vec3,
        /// m.
        radius: f32,
    },
}

/// Kind of a route.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum RouteKind {
    /// [`Route::Patrol`].
    Patrol,
    /// [`Route::Hold`].
    Hold,
    /// [`Route::Wander`].
    Wander,
    /// [`Route::Flee`].
    Flee,
}

impl Route {
    /// The kind of the route.
    pub fn kind(&self) -> RouteKind {
        match self {
            Self::Patrol { .. } => RouteKind::Patrol,
            Self::Hold { .. } => RouteKind::Hold,
            Self::Wander { .. } => RouteKind::Wander,
            Self::Flee(_) => RouteKind::Flee,
        }
    }

    /// Its places, m.
    pub fn places_mut(&mut self) -> Vec<&mut Vec3> {
        match self {
            Self::Patrol { stops, .. } => stops.iter_mut().map(|stop| &mut stop.at).collect(),
            Self::Hold { post, .. } => post.iter_mut().collect(),
            Self::Wander { area: Area::Circle { centre, .. }, .. } => vec![centre],
            Self::Wander { area: Area::Zone(_), .. } => Vec::new(),
            Self::Flee(threat) => threat.place_mut().into_iter().collect(),
        }
    }
}

/// A route, and how far an NPC has come on it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct Itinerary {
    pub route: Route,
    /// Of a patrol: index of the stop of the attempt under way, or of the next one.
    pub stop: u32,
    /// Whether a patrol goes back through its stops.
    is_returning: bool,
    /// When the next attempt begins, if none is under way.
    pub next: Tick,
    /// Whether no place was found in the area.
    pub lacks_place: bool,
}

impl Itinerary {
    /// A route that begins at `tick`.
    pub fn new(route: Route, tick: Tick) -> Self {
        Self { route, stop: 0, is_returning: false, next: tick, lacks_place: false }
    }

    /// Goes on after an attempt of the route that began at `began` and ended at `tick`. Returns the stop that the NPC
    /// reached, if it is on patrol.
    pub fn note_end(&mut self, end: End, began: Tick, tick: Tick) -> Option<u32> {
        let has_arrived = matches!(end, End::Reached | End::ReachedNear);
        let stop = self.stop;
        let (dwell, reached) = match &self.route {
            Route::Patrol { stops, .. } => (stops[stop as usize].dwell, has_arrived.then_some(stop)),
            Route::Hold { .. } => (0, None),
            Route::Wander { dwell, .. } => (*dwell, None),
            Route::Flee(_) => (0, None),
        };
        let pause = if has_arrived { dwell } else { RETRY_TICKS };
        self.next = (tick + pause).max(began + PERIOD_TICKS);
        self.advance();
        reached
    }

    /// Notes that no place was found at `tick`. An NPC that flees may be safe where it is, and looks again soon.
    pub fn note_no_place(&mut self, tick: Tick) {
        let flees = matches!(self.route, Route::Flee(_));
        (self.lacks_place, self.next) = (!flees, tick + if flees { LOOK_TICKS } else { RETRY_TICKS });
    }

    /// Moves on to the next stop of a patrol.
    fn advance(&mut self) {
        let Route::Patrol { stops, back_and_forth } = &self.route else { return };
        let last = stops.len() as u32 - 1;
        self.is_returning = *back_and_forth && (self.stop == last || self.is_returning && self.stop > 0);
        self.stop = match self.is_returning {
            true => self.stop - 1,
            false if self.stop == last => 0,
            false => self.stop + 1,
        };
    }

    /// Whether the content is valid, which the checksum of a save does not prove.
    pub fn is_sound(&self) -> bool {
        let is_heading = |facing: Option<f32>| facing.is_none_or(f32::is_finite);
        match &self.route {
            Route::Patrol { stops, .. } => {
                let is_sound = |it: &Stop| it.at.is_finite() && it.dwell <= MAX_DWELL_TICKS && is_heading(it.facing);
                STOP_COUNT.contains(&stops.len()) && (self.stop as usize) < stops.len() && stops.iter().all(is_sound)
            }
            Route::Hold { post, facing, .. } => post.is_some_and(Vec3::is_finite) && is_heading(*facing),
            Route::Wander { area, dwell } => {
                let is_sound = match area {
                    Area::Zone(_) => true,
                    Area::Circle { centre, radius } => centre.is_finite() && radius.is_finite(),
                };
                is_sound && *dwell <= MAX_DWELL_TICKS
            }
            Route::Flee(Threat { from, distance, .. }) => {
                let is_place = |at: &Vec3| at.is_finite();
                distance.is_finite()
                    && !matches!(from, Target::Moving { from, velocity, .. } if !is_place(from) || !is_place(velocity))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn patrol(stops: usize, back_and_forth: bool) -> Itinerary {
        let stop = Stop { at: Vec3::ZERO, dwell: 90, radius: 1.0, facing: None };
        Itinerary::new(Route::Patrol { stops: vec![stop; stops], back_and_forth }, Tick(5))
    }

    #[test]
    fn patrols_visit_their_stops_in_order() {
        let visits = |stops, back_and_forth| {
            let mut itinerary = patrol(stops, back_and_forth);
            (0..9).filter_map(|_| itinerary.note_end(End::Reached, Tick(0), Tick(0))).collect::<Vec<_>>()
        };
        assert_eq!(visits(3, false), [0, 1, 2, 0, 1, 2, 0, 1, 2]);
        assert_eq!(visits(4, true), [0, 1, 2, 3, 2, 1, 0, 1, 2]);
        assert_eq!(visits(2, true), [0, 1, 0, 1, 0, 1, 0, 1, 0]);
    }

    #[test]
    fn a_rest_is_the_dwell_or_the_time_until_a_retry_and_attempts_begin_a_second_apart() {
        let mut itinerary = patrol(3, false);
        assert_eq!(itinerary.note_end(End::ReachedNear, Tick(100), Tick(200)), Some(0));
        assert_eq!((itinerary.stop, itinerary.next), (1, Tick(290)));
        assert_eq!(itinerary.note_end(End::Unreachable, Tick(290), Tick(300)), None, "it was skipped");
        assert_eq!((itinerary.stop, itinerary.next), (2, Tick(480)));
        let area = Area::Circle { centre: Vec3::ZERO, radius: 5.0 };
        let mut itinerary = Itinerary::new(Route::Wander { area, dwell: 0 }, Tick(0));
        itinerary.note_end(End::Reached, Tick(10), Tick(10));
        assert_eq!(itinerary.next, Tick(70));
    }
}
