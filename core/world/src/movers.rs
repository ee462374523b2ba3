//! The movers of a world: their states, their motion, and their contacts with bodies and rays.

use crate::character::{Body, CharacterProfile, MoveScratch};
use crate::crates::{self, Crate, CrateState, Pusher};
use crate::map::mover::{FARTHEST_M, MAX_MOVER_SPEED};
use crate::map::{Map, Mover, MoverKind, MoverStop};
use crate::navigable::DOWN;
use crate::posed::{MoversNearby, Posed, REACH_M};
use crate::{MoverId, StopIdx, TICK_SECONDS, TICKS_PER_SECOND, Vec3};
use serde::{Deserialize, Serialize};

/// Slowest and fastest pace of a mover, in multiples of its usual one. No mover is faster than [`MAX_MOVER_SPEED`].
pub const PACE_RANGE: std::ops::RangeInclusive<f32> = 0.0..=4.0;
/// Greatest depth to which a mover may press a body into something before it stops, m.
const MAX_PRESS_M: f32 = 0.06;
/// A mover nearer to a body than this touches it, m.
const TOUCH_M: f32 = 0.05;
/// A crate farther than this from its original place is not at its stop, m.
const AT_PLACE_M: f32 = 0.25;
/// The mover below a body is searched from this height above the feet, m, to this depth below them, m.
const KNEE_M: f32 = 0.3;
const GAP_M: f32 = 0.08;

/// Current state of a mover.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct MoverState {
    /// The stop where it stands, or the one that it left last.
    pub from: StopIdx,
    /// The stop to which it travels; `from` while it stands.
    pub to: StopIdx,
    /// Share of that journey, 0 to 1.
    pub progress: f32,
    /// Ticks for which it has stood at its stop, saturating.
    pub stood: u32,
    /// The stop to which it was ordered and where it then stays; `None` while it cycles.
    pub ordered_stop: Option<StopIdx>,
    /// Pace in multiples of the usual one, 0 to 4. A crate with the pace 0 cannot be pushed.
    pub pace: f32,
    /// Whether it cycles back towards its first stop.
    pub is_returning: bool,
    /// Ticks for which a body has blocked it, saturating; 0 again once it moves.
    pub blocked: u32,
    /// Position and motion of a crate; `None` for all other kinds.
    pub crate_state: Option<CrateState>,
}

/// An order to a mover.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub enum MoverOrder {
    /// Go to a stop and stay there.
    GoTo(StopIdx),
    /// Travel from stop to stop, back and forth.
    Cycle,
    /// Keep this pace, in multiples of the usual one: 0 to 4.
    Pace(f32),
}

impl MoverState {
    /// Initial state of a mover.
    pub fn new(mover: &Mover) -> Self {
        Self {
            from: mover.start,
            to: mover.start,
            progress: 0.0,
            stood: 0,
            ordered_stop: (!mover.cycles).then_some(mover.start),
            pace: 1.0,
            is_returning: false,
            blocked: 0,
            crate_state: (mover.kind == MoverKind::Crate).then_some(CrateState::START),
        }
    }

    /// Encodes the states of all movers of a world for a process with the same map; empty if there are none.
    pub fn pack(states: &[Self]) -> Vec<u8> {
        if states.is_empty() { Vec::new() } else { postcard::to_stdvec(states).expect("plain data") }
    }

    /// Decodes the result of [`MoverState::pack`]; `None` if the bytes are not states of the movers of `map`.
    pub fn unpack(bytes: &[u8], map: &Map) -> Option<Vec<Self>> {
        let states = if bytes.is_empty() { Vec::new() } else { postcard::from_bytes(bytes).ok()? };
        Movers::fit(map, &states).then_some(states)
    }

    /// The stop where it stands; `None` while it travels, and for a crate that was pushed away.
    pub fn at(&self) -> Option<StopIdx> {
        let is_in_place =
            self.crate_state.is_none_or(|it| it.is_there && it.offset.length_squared() < AT_PLACE_M * AT_PLACE_M);
        (self.from == self.to && is_in_place).then_some(self.from)
    }

    /// Whether it travels to `stop` when an NPC calls it. Lifts and platforms do, once they have stood at their ordered
    /// stop for a second.
    pub(crate) fn follows_call(&self, mover: &Mover, stop: StopIdx) -> bool {
        mover.kind.is_ridden()
            && stop.idx() < mover.stops.len()
            && self.ordered_stop.is_some_and(|ordered| self.at() == Some(ordered) && ordered != stop)
            && self.stood >= TICKS_PER_SECOND
    }

    /// The stop where it stands or to which it travels.
    pub fn bound_for(&self) -> StopIdx {
        self.ordered_stop.unwrap_or(self.to)
    }

    /// Whether this can be a state of `mover`.
    pub fn fits(&self, mover: &Mover) -> bool {
        let exists = |stop: StopIdx| stop.idx() < mover.stops.len();
        exists(self.from)
            && exists(self.to)
            && self.from.0.abs_diff(self.to.0) <= 1
            && self.ordered_stop.is_none_or(exists)
            && (0.0..=1.0).contains(&self.progress)
            && PACE_RANGE.contains(&self.pace)
            && self.crate_state.is_some() == (mover.kind == MoverKind::Crate)
            && self.crate_state.is_none_or(|it| it.is_sound(FARTHEST_M))
    }

    /// Applies an order. Returns false, and changes nothing, if the mover cannot follow it. A crate returns to its
    /// original place.
    pub fn obey(&mut self, order: MoverOrder, mover: &Mover) -> bool {
        match order {
            MoverOrder::GoTo(stop) if stop.idx() < mover.stops.len() => {
                self.ordered_stop = Some(stop);
                self.crate_state = self.crate_state.map(|_| CrateState::START);
                if self.from != self.to && (self.from >= stop) == (self.to > self.from) {
                    // It reverses on the way.
                    (self.from, self.to, self.progress) = (self.to, self.from, 1.0 - self.progress);
                }
            }
            MoverOrder::Cycle if mover.stops.len() > 1 => self.ordered_stop = None,
            MoverOrder::Pace(pace) if PACE_RANGE.contains(&pace) => self.pace = pace,
            _ => return false,
        }
        true
    }

    /// Advances by one tick, at no more than the pace `most`.
    fn advance(&mut self, mover: &Mover, most: f32) {
        if self.from == self.to {
            let next = self.next_stop(mover);
            if next == self.from {
                self.stood = self.stood.saturating_add(1);
                return;
            }
            (self.to, self.stood, self.progress) = (next, 0, 0.0);
        }
        self.progress += self.pace.min(most) / mover.travel_ticks();
        if self.progress >= 1.0 {
            (self.from, self.progress) = (self.to, 0.0);
        }
    }

    /// The next stop; the current one if it stays.
    fn next_stop(&mut self, mover: &Mover) -> StopIdx {
        let towards = |stop: StopIdx| StopIdx(if stop > self.from { self.from.0 + 1 } else { self.from.0 - 1 });
        match self.ordered_stop {
            Some(stop) if stop != self.from => towards(stop),
            Some(_) => self.from,
            None if self.stood < mover.dwell_ticks() || mover.stops.len() < 2 || self.pace == 0.0 => self.from,
            None => {
                let last = mover.stops.len() - 1;
                self.is_returning = (self.is_returning || self.from.idx() == last) && self.from.0 != 0;
                StopIdx(if self.is_returning { self.from.0 - 1 } else { self.from.0 + 1 })
            }
        }
    }

    /// Current pose.
    pub fn pose(&self, mover: &Mover) -> MoverStop {
        self.crate_state.map_or_else(|| mover.between(self.from, self.to, self.progress), |it| it.pose())
    }
}

/// The movers of one world.
#[derive(Debug, Clone, Default)]
pub(crate) struct Movers {
    states: Vec<MoverState>,
    posed: Vec<Posed>,
    nearby: MoversNearby,
    /// Whether a body blocked each mover in this tick.
    blocked: Vec<bool>,
    /// States one tick ago.
    former: Vec<MoverState>,
    /// Pace at which each mover reaches the speed limit.
    top_paces: Vec<f32>,
    /// Indices of the crates.
    crates: Vec<usize>,
}

impl Movers {
    pub(crate) fn new(map: &Map) -> Self {
        let states: Vec<MoverState> = map.movers().iter().map(MoverState::new).collect();
        let posed = map.movers().iter().zip(&states).map(|(mover, state)| Posed::new(mover, state.pose(mover)));
        Self {
            posed: posed.collect(),
            nearby: MoversNearby::new(map),
            blocked: vec![false; states.len()],
            former: states.clone(),
            top_paces: map
                .movers()
                .iter()
                .map(|mover| MAX_MOVER_SPEED / mover.speed().max(f32::MIN_POSITIVE))
                .collect(),
            crates: (0..states.len()).filter(|idx| states[*idx].crate_state.is_some()).collect(),
            states,
        }
    }

    pub(crate) fn has_crates(&self) -> bool {
        !self.crates.is_empty()
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.states.is_empty()
    }

    pub(crate) fn states(&self) -> &[MoverState] {
        &self.states
    }

    /// Replaces the states; they must fit the movers of the map.
    pub(crate) fn restore(&mut self, map: &Map, states: Vec<MoverState>) {
        self.states = states;
        for ((mover, posed), state) in map.movers().iter().zip(&mut self.posed).zip(&self.states) {
            posed.place(mover, state.pose(mover));
            posed.former = posed.pose;
        }
        for idx in &self.crates {
            self.nearby.follow(MoverId(*idx as u16), &self.posed[*idx]);
        }
    }

    /// Wakes all crates, because the ground below them may have changed.
    pub(crate) fn wake_crates(&mut self) {
        for idx in &self.crates {
            self.states[*idx].crate_state.iter_mut().for_each(|it| it.rested = 0);
        }
    }

    /// Gives a mover an order. Returns false, and changes nothing, if the mover does not exist or cannot follow it.
    pub(crate) fn order(&mut self, map: &Map, id: MoverId, order: MoverOrder) -> bool {
        let mover = map.movers().get(id.idx());
        mover.zip(self.states.get_mut(id.idx())).is_some_and(|(mover, state)| state.obey(order, mover))
    }

    /// Moves all movers by one tick; the pushers push the crates.
    pub(crate) fn advance(&mut self, map: &Map, pushers: &[Pusher]) {
        self.former.clone_from(&self.states);
        let each = map.movers().iter().zip(&self.top_paces).zip(&mut self.posed).zip(&mut self.states);
        for (((mover, top_pace), posed), state) in each {
            state.advance(mover, *top_pace);
            posed.former = posed.pose;
            let pose = state.pose(mover);
            if pose != posed.pose {
                posed.place(mover, pose);
            }
        }
        self.move_crates(map, pushers);
    }

    fn move_crates(&mut self, map: &Map, pushers: &[Pusher]) {
        if self.crates.is_empty() {
            return;
        }
        let states = &self.states;
        let of = |idx: &usize| {
            states[*idx].crate_state.map(|state| Crate { idx: *idx, state, is_held: states[*idx].pace == 0.0 })
        };
        let mut crates: Vec<Crate> = self.crates.iter().filter_map(of).collect();
        crates::step(map, &self.posed, &mut crates, pushers);
        for Crate { idx, state, .. } in crates {
            self.states[idx].crate_state = Some(state);
            let (pose, mover) = (state.pose(), &map.movers()[idx]);
            if pose != self.posed[idx].pose {
                self.posed[idx].place(mover, pose);
                self.nearby.follow(MoverId(idx as u16), &self.posed[idx]);
            }
        }
    }

    /// Moves a body with the mover on which it stands, and lists the movers around it in `scratch`. Returns the
    /// velocity of the mover below the body, m/s.
    pub(crate) fn carry(
        &self,
        map: &Map,
        profile: &CharacterProfile,
        body: &mut Body,
        scratch: &mut MoveScratch,
    ) -> Vec3 {
        scratch.begin_obstacles();
        let near = self.nearby.at(body.feet);
        if near.is_empty() {
            return Vec3::ZERO;
        }
        let reach = Vec3::splat(REACH_M);
        let (low, high) = (body.feet - reach, body.feet + Vec3::new(0.0, profile.height, 0.0) + reach);
        for idx in near {
            let posed = &self.posed[idx.idx()];
            if posed.touches(low, high) {
                scratch.add_obstacles(&posed.triangles);
            }
        }
        if !body.is_grounded() || body.is_carried() {
            return Vec3::ZERO;
        }
        let Some(shift) = near.iter().find_map(|idx| self.shift_of(map, idx.idx(), body.feet)) else {
            return Vec3::ZERO;
        };
        body.shove(map.mesh(), profile, shift, scratch);
        shift / TICK_SECONDS
    }

    /// Displacement of a body at `feet` by a mover in this tick, m; `None` if the body does not stand on it, or the
    /// mover stands still.
    fn shift_of(&self, map: &Map, idx: usize, feet: Vec3) -> Option<Vec3> {
        let (mover, posed) = (&map.movers()[idx], &self.posed[idx]);
        let belt = (mover.belt * self.states[idx].pace).clamp_length_max(MAX_MOVER_SPEED) * TICK_SECONDS;
        if (posed.pose == posed.former && belt == Vec3::ZERO) || !posed.pose.is_there {
            return None;
        }
        // Undo the former pose of the mover, and apply the current one.
        let (former, pose) = (posed.former, posed.pose);
        let back = MoverStop { offset: Vec3::ZERO, yaw: -former.yaw, ..former };
        let carried = mover.placed(pose, mover.placed(back, feet - former.offset));
        let knee = carried + Vec3::Y * KNEE_M;
        posed.cast_ray(knee, DOWN, KNEE_M + GAP_M).map(|_| carried - feet + belt)
    }

    /// Records the movers that press a body too deep into something.
    pub(crate) fn mark_blocked(&mut self, profile: &CharacterProfile, body: &Body, scratch: &MoveScratch) {
        let near = self.nearby.at(body.feet);
        let is_pressed = || scratch.deepest_contact(profile, body.feet).is_some_and(|it| it.depth > MAX_PRESS_M);
        if near.is_empty() || !is_pressed() {
            return;
        }
        let reach = profile.radius + TOUCH_M;
        let (low, height) = (body.feet + Vec3::Y * profile.radius, profile.height - 2.0 * profile.radius);
        for idx in near {
            let posed = &self.posed[idx.idx()];
            let touches = || posed.triangles.iter().any(|it| it.capsule_contact(low, height, reach).is_some());
            self.blocked[idx.idx()] |= posed.pose != posed.former && touches();
        }
    }

    /// Undoes the motion of each blocked mover.
    pub(crate) fn undo_blocked(&mut self, map: &Map) {
        for (idx, blocked) in self.blocked.iter_mut().enumerate() {
            let state = &mut self.states[idx];
            if !std::mem::take(blocked) {
                state.blocked = 0;
                continue;
            }
            let crate_state = self.former[idx].crate_state.map(CrateState::halted);
            *state = MoverState { blocked: state.blocked.saturating_add(1), crate_state, ..self.former[idx] };
            let former = self.posed[idx].former;
            self.posed[idx].place(&map.movers()[idx], former);
            if crate_state.is_some() {
                self.nearby.follow(MoverId(idx as u16), &self.posed[idx]);
            }
        }
    }

    /// Distance of the first mover that a ray hits within `most` metres.
    pub(crate) fn cast_ray(&self, origin: Vec3, direction: Vec3, most: f32) -> Option<f32> {
        let end = origin + direction * most;
        let (low, high) = (origin.min(end), origin.max(end));
        let near = self.posed.iter().filter(|posed| posed.touches(low, high));
        near.filter_map(|posed| posed.cast_ray(origin, direction, most)).min_by(f32::total_cmp)
    }

    /// Calls `found` with the index and distance, m, of each ray that hits a mover within `range` metres, once for each
    /// mover that it hits.
    pub(crate) fn cast_cone(&self, eye: Vec3, directions: &[Vec3], range: f32, mut found: impl FnMut(usize, f32)) {
        let (low, high) = (eye - Vec3::splat(range), eye + Vec3::splat(range));
        for posed in self.posed.iter().filter(|posed| posed.touches(low, high)) {
            let (offset, radius) = ((posed.low + posed.high) * 0.5 - eye, 0.5 * posed.low.distance(posed.high));
            for (idx, direction) in directions.iter().enumerate() {
                let along = offset.dot(*direction);
                // The ray misses the sphere around the mover.
                if along < -radius || offset.length_squared() - along * along > radius * radius {
                    continue;
                }
                if let Some(distance) = posed.cast_ray(eye, *direction, range) {
                    found(idx, distance);
                }
            }
        }
    }

    /// Whether these can be the states of the movers of a map.
    pub(crate) fn fit(map: &Map, states: &[MoverState]) -> bool {
        states.len() == map.movers().len() && states.iter().zip(map.movers()).all(|(state, mover)| state.fits(mover))
    }
}
