//! Reliance: the stops of each mover that allow a body to be where it is.

use crate::character::{Body, CharacterProfile};
use crate::map::{Map, Mover};
use crate::movers::MoverState;
use crate::navigable::DOWN;
use crate::posed::{MoversNearby, Posed, REACH_M};
use crate::{MoverId, StopIdx, StopSet, Vec3};

/// Overlap from which a mover obstructs a body, m.
const IN_THE_WAY_M: f32 = 0.05;
/// Height of a mover above the feet up to which the body stands on it, m.
const STEP_ON_M: f32 = 0.15;
/// Ground below a body is searched from this height above the feet, m, to this depth below them, m.
const KNEE_M: f32 = 0.3;
const GAP_M: f32 = 0.12;

/// The movers of a map at all of their stops.
#[derive(Debug, Clone)]
pub struct Reliance {
    /// Each mover at each of its stops.
    posed: Vec<Vec<Posed>>,
    /// Boxes around the journeys of each mover between neighbouring stops; around the mover itself if it has one stop.
    swept: Vec<Vec<(Vec3, Vec3)>>,
    /// Movers by the places of all their stops.
    nearby: MoversNearby,
}

impl Reliance {
    /// Prepares the movers of a map.
    pub fn on(map: &Map) -> Self {
        let posed = |mover: &Mover| mover.stops.iter().map(|stop| Posed::new(mover, *stop)).collect();
        let journeys = |mover: &Mover| {
            let stops: Vec<(Vec3, Vec3)> = (0..mover.stops.len()).map(|stop| mover.bounds_at(stop)).collect();
            let around = |pair: &[(Vec3, Vec3)]| (pair[0].0.min(pair[1].0), pair[0].1.max(pair[1].1));
            if stops.len() == 1 { stops } else { stops.windows(2).map(around).collect() }
        };
        Self {
            posed: map.movers().iter().map(posed).collect(),
            swept: map.movers().iter().map(journeys).collect(),
            nearby: MoversNearby::new(map),
        }
    }

    /// Whether the map has no movers.
    pub fn has_no_movers(&self) -> bool {
        self.posed.is_empty()
    }

    /// Calls `note` with each mover on which `body` relies, and the set of its stops that allow the body to be where it
    /// is.
    pub fn find_needs(
        &self,
        map: &Map,
        states: &[MoverState],
        profile: &CharacterProfile,
        body: &Body,
        mut note: impl FnMut(MoverId, StopSet),
    ) {
        let (low, height) = (body.feet + Vec3::Y * profile.radius, profile.height - 2.0 * profile.radius);
        let reach = Vec3::new(profile.radius, KNEE_M, profile.radius);
        let (least, most) = (body.feet - reach, body.feet + reach + Vec3::new(0.0, profile.height, 0.0));
        for &id in self.nearby.at(body.feet) {
            let at = id.idx();
            let (mover, state) = (&map.movers()[at], &states[at]);
            let mut possible = mover.all_stops();
            for (stop, posed) in (0..).map(StopIdx).zip(&self.posed[at]).filter(|(_, it)| it.touches(least, most)) {
                if state.at() == Some(stop) {
                    if body.is_grounded() && carries(posed, body.feet) && !has_ground(map, profile, body.feet) {
                        possible = possible.intersection(StopSet::only(stop));
                    }
                } else if is_obstructed(posed, low, height, profile.radius) {
                    possible = possible.difference(StopSet::only(stop));
                }
            }
            if possible != mover.all_stops() {
                note(id, possible);
            }
        }
    }

    /// Whether the path of a mover touches a body at `feet`, or comes nearer to it than `margin`, m, which is at most
    /// 0.5.
    pub fn is_swept(&self, profile: &CharacterProfile, feet: Vec3, margin: f32) -> bool {
        debug_assert!(profile.radius + margin <= REACH_M, "movers are listed within {REACH_M} m");
        let reach = Vec3::new(profile.radius + margin, 0.0, profile.radius + margin);
        // Movers below the feet do not obstruct the body.
        let (least, most) = (feet - reach + Vec3::Y * STEP_ON_M, feet + reach + Vec3::Y * profile.height);
        let is_in = |(low, high): &(Vec3, Vec3)| low.cmple(most).all() && high.cmpge(least).all();
        self.nearby.at(feet).iter().any(|idx| self.swept[idx.idx()].iter().any(is_in))
    }
}

/// Whether a mover carries a body at `feet`.
fn carries(mover: &Posed, feet: Vec3) -> bool {
    let knee = feet + Vec3::Y * KNEE_M;
    mover.triangles.iter().any(|triangle| triangle.ray(knee, DOWN, 0.0, KNEE_M + GAP_M).is_some())
}

/// Whether a mover obstructs the capsule around the segment of length `height` above `low`.
fn is_obstructed(mover: &Posed, low: Vec3, height: f32, radius: f32) -> bool {
    let mut contacts = mover.triangles.iter().filter_map(|triangle| triangle.capsule_contact(low, height, radius));
    contacts.any(|contact| contact.depth > IN_THE_WAY_M)
}

/// Whether the map itself has ground close below the feet.
fn has_ground(map: &Map, profile: &CharacterProfile, feet: Vec3) -> bool {
    let from = feet + Vec3::Y * KNEE_M;
    let below = map.mesh().cast_ray(from, DOWN, KNEE_M + profile.step_height);
    below.is_some_and(|hit| hit.surface.is_solid())
}
