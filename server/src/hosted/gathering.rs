//! Places around goals that several NPCs share, so that they stand beside each other instead of pushing.
//!
//! The first NPC that comes near a goal gets the goal itself, the next ones places around it: compact, with ground all
//! around, each a straight walk from its neighbour. An NPC that can come no closer, because others stand in its way,
//! ends its attempt beside them.

use crate::ids::NpcId;
use std::collections::{BTreeSet, VecDeque};
use surefoot_world::{NpcSlot, Tick, Vec3, World};

/// Distance from the goal at which an NPC gets a place, m.
pub(super) const NEAR_M: f32 = 8.0;
/// Distance within which an NPC has arrived at a place beside the goal, m.
pub(super) const PLACE_RADIUS_M: f32 = 0.5;
/// Distance between goals up to which NPCs share them, m.
const SAME_GOAL_M: f32 = 1.0;
/// Gap between the bodies of NPCs that stand beside each other, m.
const GAP_M: f32 = 0.2;
/// Gap up to which an NPC is blocked by another, m.
const TOUCH_M: f32 = 0.35;
/// Most places around a goal.
const MAX_PLACES: usize = 128;
/// Ticks without coming closer to its place after which an NPC that others block stays where it is.
const BLOCKED_TICKS: u64 = 60;

/// The goals near which there are NPCs.
#[derive(Debug, Default)]
pub(super) struct Gatherings(Vec<Gathering>);

/// Places around one goal.
#[derive(Debug)]
struct Gathering {
    goal: Vec3,
    /// The goal itself, and once a second NPC comes near, the places around it, the nearest first.
    places: Vec<Place>,
    is_complete: bool,
}

#[derive(Debug)]
struct Place {
    at: Vec3,
    npc: Option<NpcId>,
}

/// An NPC's place at its goal, and how it comes closer to it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Reserved {
    /// The place, m.
    pub at: Vec3,
    /// Smallest distance from it so far, m, and when it shrank.
    best_m: f32,
    since: Tick,
}

impl Reserved {
    fn new(at: Vec3, tick: Tick) -> Self {
        Self { at, best_m: f32::INFINITY, since: tick }
    }

    /// Records where the NPC is at `tick`; returns whether it has come no closer for a while.
    pub fn is_blocked(&mut self, feet: Vec3, tick: Tick) -> bool {
        /// m.
        const CLOSER_M: f32 = 0.1;
        let distance = feet.distance(self.at);
        if distance < self.best_m - CLOSER_M {
            (self.best_m, self.since) = (distance, tick);
        }
        tick.since(self.since) >= BLOCKED_TICKS
    }
}

impl Gatherings {
    /// Reserves a place for an NPC that comes near its goal, m; the goal itself, if no place is left.
    pub fn reserve(&mut self, world: &World, (npc, slot): (NpcId, NpcSlot), goal: Vec3) -> Reserved {
        let known = self.0.iter().position(|gathering| gathering.goal.distance(goal) <= SAME_GOAL_M);
        let idx = known.unwrap_or_else(|| {
            let place = Place { at: goal, npc: None };
            self.0.push(Gathering { goal, places: vec![place], is_complete: false });
            self.0.len() - 1
        });
        let feet = world.npc(slot).expect("every record has an NPC").body.feet;
        let at = self.0[idx].take_place(world, (npc, slot), feet);
        Reserved::new(at.unwrap_or(goal), world.current_tick())
    }

    /// Lets an NPC keep the place where it stands, m, instead of its own.
    pub fn keep(&mut self, npc: NpcId, goal: Vec3, feet: Vec3) {
        self.release(npc);
        if let Some(gathering) = self.0.iter_mut().find(|gathering| gathering.goal.distance(goal) <= SAME_GOAL_M) {
            gathering.places.push(Place { at: feet, npc: Some(npc) });
        }
    }

    /// NPCs with a place at a goal, m.
    pub fn npcs_at(&self, goal: Vec3) -> impl Iterator<Item = NpcId> {
        let shared = self.0.iter().filter(move |gathering| gathering.goal.distance(goal) <= SAME_GOAL_M);
        shared.flat_map(|gathering| gathering.places.iter().filter_map(|place| place.npc))
    }

    /// Gives the place of an NPC back.
    pub fn release(&mut self, npc: NpcId) {
        self.0.retain_mut(|gathering| {
            gathering.places.iter_mut().filter(|place| place.npc == Some(npc)).for_each(|place| place.npc = None);
            gathering.places.iter().any(|place| place.npc.is_some())
        });
    }
}

impl Gathering {
    /// The nearest free place to the goal; of equally near ones, that nearest to the NPC.
    fn take_place(&mut self, world: &World, (npc, slot): (NpcId, NpcSlot), feet: Vec3) -> Option<Vec3> {
        let spacing = spacing(world, slot);
        if self.places[0].npc.is_some() && !self.is_complete {
            self.add_places(world, slot, spacing);
        }
        let goal = self.goal;
        let ring = |place: &Place| (place.at.distance(goal) / spacing) as u32;
        let free = self.places.iter_mut().filter(|place| place.npc.is_none());
        let place = free.min_by(|a, b| {
            let nearer = a.at.distance_squared(feet).total_cmp(&b.at.distance_squared(feet));
            ring(a).cmp(&ring(b)).then(nearer)
        })?;
        place.npc = Some(npc);
        Some(place.at)
    }

    /// Adds the places around the goal, on a triangular lattice.
    fn add_places(&mut self, world: &World, slot: NpcSlot, spacing: f32) {
        self.is_complete = true;
        let half_height = spacing * 3.0f32.sqrt() * 0.5;
        let steps = [(2, 0), (1, 1), (-1, 1), (-2, 0), (-1, -1), (1, -1)];
        let mut seen = BTreeSet::from([(0, 0)]);
        let mut open = VecDeque::from([((0i32, 0i32), self.goal)]);
        while let Some(((column, row), from)) = open.pop_front() {
            for (along, across) in steps {
                let cell = (column + along, row + across);
                if self.places.len() >= MAX_PLACES || seen.contains(&cell) {
                    continue;
                }
                let offset = Vec3::new(along as f32 * spacing * 0.5, 0.0, across as f32 * half_height);
                if let Some(at) = world.place_beside(slot, from, offset) {
                    seen.insert(cell);
                    self.places.push(Place { at, npc: None });
                    open.push_back((cell, at));
                }
            }
        }
    }
}

/// Distance between the places of NPCs that stand beside each other, m.
fn spacing(world: &World, slot: NpcSlot) -> f32 {
    2.0 * world.profile_of(world.npc(slot).expect("every record has an NPC")).radius + GAP_M
}

/// Whether two NPCs stand so close that one blocks the other.
pub(super) fn touch(world: &World, one: NpcSlot, other: NpcSlot) -> bool {
    let body = |slot| world.npc(slot).map(|npc| (npc.body.feet, world.profile_of(npc).radius));
    body(one).zip(body(other)).is_some_and(|((feet, radius), (other_feet, other_radius))| {
        feet.distance(other_feet) <= radius + other_radius + TOUCH_M
    })
}
