//! NPCs on routes: the attempts that worlds begin by themselves.

use super::commands::NpcError;
use super::events::EventKind;
use super::itinerary::{Area, Itinerary, Route};
use super::pursuit::Pursuit;
use super::snapshot::Standing;
use super::world::{HostedWorld, NpcRecord};
use crate::ids::NpcId;
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use surefoot_planner::Shape;
use surefoot_world::arrival::SNAP_M;
use surefoot_world::{End, NpcSlot, Tick, Vec3};

/// Distance from its place within which an NPC that holds it arrives, m.
const POST_RADIUS_M: f32 = 0.5;
/// Most attempts that routes begin in one tick; the others begin in the next ticks.
const MAX_BEGUN: usize = 32;
/// Most draws of a place in an area.
const MAX_DRAWS: usize = 32;

impl HostedWorld {
    /// Sets the route of an NPC, or clears it. An attempt of its former route ends; a goal of a client stays.
    pub fn set_route(&mut self, id: NpcId, route: Option<Route>) -> Result<(), NpcError> {
        let record = self.records.get(&id).ok_or(NpcError::Unknown(id))?;
        let is_down = self.world.npc(record.slot).is_some_and(|npc| npc.harm.is_some());
        let route = match route {
            Some(_) if is_down => return Err(NpcError::Down(id)),
            route => route.map(|route| self.placed(id, record.slot, route)).transpose()?,
        };
        let (is_cleared, is_on_route) = (record.itinerary.is_some() && route.is_none(), record.is_on_route());
        if is_on_route {
            self.drop_goal(id)?;
        }
        let (kind, tick) = (route.as_ref().map(Route::kind), self.tick());
        let record = self.records.get_mut(&id).ok_or(NpcError::Unknown(id))?;
        record.itinerary = route.map(|route| Itinerary::new(route, tick));
        if kind.is_some() || is_cleared {
            self.log_event(id, EventKind::RouteSet { kind });
        }
        Ok(())
    }

    /// The route of an NPC; `None` if it has none.
    pub fn route(&self, id: NpcId) -> Result<Option<Route>, NpcError> {
        let record = self.records.get(&id).ok_or(NpcError::Unknown(id))?;
        Ok(record.itinerary.as_ref().map(|itinerary| itinerary.route.clone()))
    }

    /// A route whose places are on the map, where the NPC can stand.
    fn placed(&self, id: NpcId, slot: NpcSlot, mut route: Route) -> Result<Route, NpcError> {
        let stand_at = |at: Vec3, field: String| {
            self.check_inside(at, field.as_str())?;
            self.world.footing(slot, at, SNAP_M).map_err(|why| NpcError::NoRoom { field, why })
        };
        match &mut route {
            Route::Patrol { stops, .. } => {
                for (idx, stop) in stops.iter_mut().enumerate() {
                    stop.at = stand_at(stop.at, format!("patrol.stops[{idx}].position"))?;
                }
            }
            Route::Hold { post, .. } => {
                let feet = self.world.npc(slot).expect("every record has an NPC").body.feet;
                *post = Some(stand_at(post.unwrap_or(feet), "hold.position".to_owned())?);
            }
            Route::Wander { area: Area::Circle { centre, .. }, .. } => {
                self.check_inside(*centre, "wander.circle.centre")?;
            }
            Route::Wander { area: Area::Zone(name), .. } if !self.zones.contains_key(name) => {
                return Err(NpcError::NoZone(self.id, name.clone()));
            }
            Route::Wander { .. } => {}
            Route::Flee(threat) => {
                self.check_inside(self.place_of(id, threat.from)?, "flee.position")?;
            }
        }
        Ok(route)
    }

    /// Begins the attempts of routes that are due.
    pub(super) fn follow_routes(&mut self) {
        self.look_at_threats();
        let tick = self.tick();
        let is_up = |record: &NpcRecord| self.world.npc(record.slot).is_some_and(|npc| npc.harm.is_none());
        let due = self.records.iter().filter(|(_, record)| record.is_due(tick) && is_up(record)).map(|(&id, _)| id);
        for id in due.take(MAX_BEGUN).collect::<Vec<_>>() {
            let next = self.next_goal(id);
            let itinerary = self.records.get_mut(&id).and_then(|record| record.itinerary.as_mut());
            let itinerary = itinerary.expect("an NPC that is due has a route");
            match next {
                Some((goal, pursuit)) => {
                    itinerary.lacks_place = false;
                    self.begin_attempt(id, goal, pursuit);
                }
                None => itinerary.note_no_place(tick),
            }
        }
    }

    /// The next goal of an NPC's route, m; `None` if there is no place for it.
    fn next_goal(&self, id: NpcId) -> Option<(Vec3, Pursuit)> {
        let record = self.records.get(&id)?;
        let itinerary = record.itinerary.as_ref()?;
        let usual = Pursuit { is_of_route: true, ..Pursuit::default() };
        match &itinerary.route {
            Route::Patrol { stops, .. } => {
                let stop = stops[itinerary.stop as usize];
                Some((stop.at, Pursuit { radius: stop.radius, facing: stop.facing, ..usual }))
            }
            &Route::Hold { post, radius, facing } => {
                let slack = radius - POST_RADIUS_M;
                Some((post?, Pursuit { radius: POST_RADIUS_M, keeps: true, slack, facing, ..usual }))
            }
            Route::Wander { area, .. } => Some((self.draw_place(id, record.slot, area)?, usual)),
            Route::Flee(threat) => self.refuge(id, record.slot, *threat),
        }
    }

    /// What an NPC draws from at this tick: equal worlds draw equal places.
    pub(super) fn draws_of(&self, id: NpcId) -> ChaCha8Rng {
        ChaCha8Rng::seed_from_u64(u64::from(id.serial()) << 32 ^ self.tick().0)
    }

    /// Draws a place of an area where an NPC can stand, away from rims and liquids; `None` if none was found.
    fn draw_place(&self, id: NpcId, slot: NpcSlot, area: &Area) -> Option<Vec3> {
        let shape = match *area {
            Area::Zone(ref name) => self.zones.get(name)?.shape,
            Area::Circle { centre, radius } => {
                Shape::Cylinder { bottom: centre - Vec3::Y * SNAP_M, radius, height: 2.0 * SNAP_M }
            }
        };
        let bounds = shape.bounds();
        let (low, high) = (bounds.low.max(Vec3::ZERO), bounds.high.min(self.world.map().extent()));
        let mut rng = self.draws_of(id);
        (0..MAX_DRAWS).find_map(|_| {
            let at = low + (high - low) * Vec3::new(rng.random(), rng.random(), rng.random());
            let place = self.world.footing_below(slot, at)?;
            let place = self.world.place_beside(slot, place, Vec3::ZERO)?;
            (shape.contains(place) && self.within_map(place).is_ok()).then_some(place)
        })
    }
}

impl NpcRecord {
    /// Whether the attempt under way, or the one that follows it, is of the NPC's route.
    fn is_on_route(&self) -> bool {
        self.goal.is_some() && self.pursuit.is_of_route || self.retry.is_some_and(|retry| retry.pursuit.is_of_route)
    }

    /// Whether the next attempt of the NPC's route begins at `tick`, unless the NPC is down.
    fn is_due(&self, tick: Tick) -> bool {
        let is_free = self.goal.is_none() && self.retry.is_none();
        is_free && self.itinerary.as_ref().is_some_and(|itinerary| itinerary.next <= tick)
    }

    /// Lets the route go on after an attempt that ended at `tick`. Returns the stop that the NPC has reached, if any.
    pub fn note_route(&mut self, end: End, tick: Tick) -> Option<u32> {
        let itinerary = self.itinerary.as_mut().filter(|_| self.pursuit.is_of_route)?;
        itinerary.note_end(end, self.began, tick)
    }

    /// Why the NPC, which has no goal, stands; `None` if no attempt follows by itself.
    pub fn rest(&self) -> Option<Standing> {
        match (&self.itinerary, self.retry) {
            (None, None) => None,
            (Some(itinerary), None) if itinerary.lacks_place => Some(Standing::NoPlace),
            _ => Some(Standing::Rests),
        }
    }
}
