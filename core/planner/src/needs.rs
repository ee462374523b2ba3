//! What an edge depends on: movers that must stand at certain stops while an NPC runs along it, and rides on movers.

use serde::{Deserialize, Serialize};
use surefoot_world::map::mover::{MAX_MOVERS, MAX_STOPS};
use surefoot_world::map::{Mover, MoverKind};
use surefoot_world::{Map, MoverAt, MoverId, MoverState, StopIdx, StopSet};

/// Greatest number of movers that one edge depends on; those that were noticed first count.
const MAX_NEEDS: usize = 4;

/// A mover that must stand at one of some stops.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct Need {
    /// The mover.
    pub mover: MoverId,
    /// The stops, at least one.
    pub stops: StopSet,
}

/// A ride from one stop of a mover to another.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Ride {
    /// The mover.
    pub mover: MoverId,
    /// The stop where the ride begins.
    pub from: StopIdx,
    /// The stop where it ends.
    pub to: StopIdx,
}

impl Ride {
    /// The ride from one stop to another; `None` unless they are different stops of one mover.
    pub fn between(from: MoverAt, to: MoverAt) -> Option<Self> {
        let is_ride = from.mover == to.mover && from.stop != to.stop;
        is_ride.then_some(Self { mover: from.mover, from: from.stop, to: to.stop })
    }
}

/// The movers that an edge depends on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct Needs {
    #[serde(with = "need_list")]
    list: [Option<Need>; MAX_NEEDS],
    /// The ride that the edge consists of, if it is one.
    pub ride: Option<Ride>,
}

/// In files, an entry without stops stands for none.
mod need_list {
    use super::{MAX_NEEDS, Need};
    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    pub fn serialize<S: Serializer>(list: &[Option<Need>; MAX_NEEDS], serializer: S) -> Result<S::Ok, S::Error> {
        list.map(Option::unwrap_or_default).serialize(serializer)
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<[Option<Need>; MAX_NEEDS], D::Error> {
        let list = <[Need; MAX_NEEDS]>::deserialize(deserializer)?;
        Ok(list.map(|need| Some(need).filter(|need| !need.stops.is_empty())))
    }
}

impl Needs {
    /// A ride depends on its mover standing where it begins.
    pub fn of_ride(ride: Ride) -> Self {
        let mut needs = Self { ride: Some(ride), ..Self::default() };
        needs.add(Need { mover: ride.mover, stops: StopSet::only(ride.from) });
        needs
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.ride.is_none() && self.iter().next().is_none()
    }

    /// The movers, each once.
    pub fn iter(&self) -> impl Iterator<Item = Need> {
        self.list.into_iter().flatten()
    }

    /// Adds a need. A need of the same mover is narrowed to the common stops; if there are none, the former need stays.
    pub fn add(&mut self, need: Need) {
        if let Some(known) = self.list.iter_mut().flatten().find(|known| known.mover == need.mover) {
            let common = known.stops.intersection(need.stops);
            if !common.is_empty() {
                known.stops = common;
            }
        } else if let Some(free) = self.list.iter_mut().find(|known| known.is_none()) {
            *free = Some(need).filter(|need| !need.stops.is_empty());
        }
    }

    /// Adds all that another try along the same edge depended on.
    pub fn merge(&mut self, other: &Self) {
        other.iter().for_each(|need| self.add(need));
        self.ride = self.ride.or(other.ride);
    }

    /// Whether a map can have these movers and stops: each mover is listed once, and a ride begins where its mover must
    /// stand.
    pub fn are_possible(&self) -> bool {
        let is_mover = |mover: MoverId| mover.idx() < MAX_MOVERS;
        let is_stop = |stop: StopIdx| stop.idx() < MAX_STOPS;
        let is_listed_again = |idx: usize, mover: MoverId| self.iter().skip(idx + 1).any(|other| other.mover == mover);
        let begins = |ride: Ride| self.iter().any(|need| need.mover == ride.mover && need.stops.contains(ride.from));
        let is_possible = |ride: Ride| is_stop(ride.from) && is_stop(ride.to) && ride.from != ride.to && begins(ride);
        self.iter().enumerate().all(|(idx, need)| is_mover(need.mover) && !is_listed_again(idx, need.mover))
            && self.ride.is_none_or(is_possible)
    }

    /// Whether an NPC can use the edge while each mover stands only at `stops`, in the order of the map. Movers that
    /// are not listed stand anywhere. A ride needs both of its stops.
    pub fn are_met(&self, stops: &[StopSet]) -> bool {
        let stops_of = |mover: MoverId| stops.get(mover.idx()).copied().unwrap_or(StopSet::ALL);
        self.iter().all(|need| !need.stops.intersection(stops_of(need.mover)).is_empty())
            && self.ride.is_none_or(|ride| stops_of(ride.mover).contains(ride.to))
    }
}

/// The stops at which a mover stands sooner or later, unless something other than an NPC moves it.
pub fn stops_ahead(mover: &Mover, state: &MoverState) -> StopSet {
    match (state.ordered_stop, state.at()) {
        (_, at) if mover.kind == MoverKind::Crate => at.map_or(StopSet::default(), StopSet::only),
        (_, Some(at)) if state.pace == 0.0 => StopSet::only(at),
        (_, None) if state.pace == 0.0 => StopSet::default(),
        (Some(stop), _) if !mover.kind.is_ridden() => StopSet::only(stop),
        _ => mover.all_stops(),
    }
}

/// The [`stops_ahead`] of all movers of a map; empty if each mover stands at all of its stops, or there are none.
pub fn all_stops_ahead(map: &Map, states: &[MoverState]) -> Vec<StopSet> {
    let ahead: Vec<StopSet> = map.movers().iter().zip(states).map(|(mover, state)| stops_ahead(mover, state)).collect();
    let is_free = |(mover, stops): (&Mover, &StopSet)| *stops == mover.all_stops();
    if map.movers().iter().zip(&ahead).all(is_free) { Vec::new() } else { ahead }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn needs_of_the_same_mover_are_narrowed_and_others_are_added() {
        let mut needs = Needs::default();
        assert!(needs.is_empty() && needs.are_met(&[0, 0, 0].map(StopSet)));
        needs.add(Need { mover: MoverId(1), stops: StopSet(0b110) });
        needs.add(Need { mover: MoverId(1), stops: StopSet(0b011) });
        needs.add(Need { mover: MoverId(2), stops: StopSet(0b001) });
        assert_eq!(
            needs.iter().collect::<Vec<_>>(),
            [Need { mover: MoverId(1), stops: StopSet(0b010) }, Need { mover: MoverId(2), stops: StopSet(0b001) }]
        );
        assert!(needs.are_met(&[]) && needs.are_met(&[0, 0b010, 0b101].map(StopSet)));
        assert!(!needs.are_met(&[0, 0b001, 1].map(StopSet)) && !needs.are_met(&[0, 0b010, 0b110].map(StopSet)));
    }

    #[test]
    fn a_ride_needs_both_of_its_stops() {
        let needs = Needs::of_ride(Ride { mover: MoverId(0), from: StopIdx(0), to: StopIdx(2) });
        assert!(
            needs.are_met(&[0b101].map(StopSet))
                && !needs.are_met(&[0b001].map(StopSet))
                && !needs.are_met(&[0b100].map(StopSet))
        );
    }

    #[test]
    fn needs_that_no_map_can_have_are_not_possible() {
        let ride = Ride { mover: MoverId(2), from: StopIdx(0), to: StopIdx(15) };
        let possible = Needs::of_ride(ride);
        assert!(possible.are_possible() && Needs::default().are_possible());
        let mut other_mover = Needs::default();
        other_mover.add(Need { mover: MoverId(1023), stops: StopSet(u16::MAX) });
        assert!(other_mover.are_possible());
        let mut twice = possible;
        twice.list[3] = twice.list[0];
        let mut no_mover = possible;
        no_mover.add(Need { mover: MoverId(1024), stops: StopSet(1) });
        let impossible = [
            twice,
            no_mover,
            Needs { ride: Some(ride), ..Needs::default() },
            Needs { ride: Some(Ride { from: StopIdx(1), ..ride }), ..possible },
            Needs { ride: Some(Ride { to: StopIdx(0), ..ride }), ..possible },
            Needs { ride: Some(Ride { to: StopIdx(16), ..ride }), ..possible },
            Needs { ride: Some(Ride { from: StopIdx(200), ..ride }), ..possible },
        ];
        assert!(impossible.iter().all(|needs| !needs.are_possible()), "{impossible:?}");
    }

    #[test]
    fn rides_join_stops_of_one_mover() {
        let between = |movers: [u16; 2], stops: [u8; 2]| {
            let [from, to] = [0, 1].map(|end| MoverAt { mover: MoverId(movers[end]), stop: StopIdx(stops[end]) });
            Ride::between(from, to)
        };
        assert_eq!(between([4, 4], [1, 0]), Some(Ride { mover: MoverId(4), from: StopIdx(1), to: StopIdx(0) }));
        assert_eq!((between([4, 5], [1, 0]), between([4, 4], [1, 1])), (None, None));
    }
}
