//! What the animation of a level's node says of how a mover moves: its stops, and the times between them.

use surefoot_world::Vec3;
use surefoot_world::float::distance_to_segment;

/// The animation of a node, relative to where the file places it at rest. Times are in seconds, ascending.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct Animation {
    /// Shifts of the node, in the level's coordinates.
    pub(super) shifts: Vec<(f32, Vec3)>,
    /// Turns about the upright axis through its origin, counter-clockwise seen from above, rad.
    pub(super) turns: Vec<(f32, f32)>,
}

/// A journey there and back, as a mover makes it.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Journey {
    /// Shift to the first stop, m.
    pub(super) begin: Vec3,
    /// Shifts from there to the others, m.
    pub(super) path: Vec<Vec3>,
    /// Duration of the way from one stop to the next, s.
    pub(super) travel_s: f32,
    /// Time at each stop, s.
    pub(super) dwell_s: f32,
}

impl Journey {
    /// Whether it leads up or down more than aside.
    pub(super) fn is_upright(&self) -> bool {
        let extent = |of: fn(&Vec3) -> f32| self.path.iter().map(of).fold(0.0, f32::max);
        extent(|stop| stop.y.abs()) >= extent(|stop| Vec3::new(stop.x, 0.0, stop.z).length())
    }

    /// The same journey with one further stop, the farthest, as doors have.
    pub(super) fn without_stops_between(mut self) -> Self {
        let farthest = self.path.iter().copied().max_by(|one, other| one.length().total_cmp(&other.length()));
        self.travel_s *= self.path.len() as f32;
        self.path = farthest.into_iter().collect();
        self
    }
}

/// Most stops of a mover.
const MAX_STOPS: usize = 16;
/// Most keys that are looked at, which bounds the work that a file can cause.
const MAX_KEYS: usize = 512;
/// Detail beyond which an animation is no way between stops, m.
const MOST_SLACK_M: f32 = 100.0;
/// Distance below which two places of an animation are one, m.
const SAME_M: f32 = 0.05;
/// Least change of velocity at a key that matters, m/s.
const LEAST_BEND: f32 = 0.01;
/// Least angle that opens a door, rad.
const LEAST_TURN: f32 = 0.2;

impl Animation {
    /// The journey along the shifts; `None` if the node stays where it is.
    pub(super) fn journey(&self, to_metres: impl Fn(Vec3) -> Vec3) -> Option<Journey> {
        let places: Vec<(f32, Vec3)> = self.shifts.iter().map(|(at, shift)| (*at, to_metres(*shift))).collect();
        let places = thinned(places);
        let (&(start, begin), &(end, _)) = (places.first()?, places.last()?);
        let mut slack = SAME_M;
        let stops = loop {
            let kept = simplified(&places, slack);
            let stops = one_way(kept.iter().map(|&idx| places[idx].1));
            if stops.len() <= MAX_STOPS || slack > MOST_SLACK_M {
                break stops;
            }
            slack *= 4.0;
        };
        if !(2..=MAX_STOPS).contains(&stops.len()) {
            return None;
        }
        // The longest time without motion is that at a stop.
        let rests = places.windows(2).filter(|pair| pair[0].1.distance(pair[1].1) <= SAME_M);
        let rests: Vec<f32> = rests.map(|pair| pair[1].0 - pair[0].0).collect();
        let moving_s = (end - start - rests.iter().sum::<f32>()).max(0.0);
        let returns = places.last().is_some_and(|(_, place)| place.distance(begin) <= SAME_M);
        let legs = (stops.len() - 1) * if returns { 2 } else { 1 };
        Some(Journey {
            begin,
            path: stops[1..].iter().map(|stop| *stop - begin).collect(),
            travel_s: moving_s / legs as f32,
            dwell_s: rests.into_iter().fold(0.0, f32::max),
        })
    }

    /// The angle by which it opens a door, rad, and how long that takes, s; `None` if it does not turn.
    pub(super) fn swing(&self) -> Option<(f32, f32)> {
        let &(start, first) = self.turns.first()?;
        let widest = self.turns.iter().max_by(|one, other| (one.1 - first).abs().total_cmp(&(other.1 - first).abs()));
        let &(end, turn) = widest.expect("there is a first one");
        ((turn - first).abs() >= LEAST_TURN).then_some((turn - first, end - start))
    }
}

/// The places without those that lie where the ones around them lead anyway, and evenly chosen ones if these are still
/// too many.
fn thinned(places: Vec<(f32, Vec3)>) -> Vec<(f32, Vec3)> {
    let last = places.len().saturating_sub(1);
    let turns = |idx: usize| {
        let velocity = |one: usize, other: usize| {
            let ((start, from), (end, to)) = (places[one], places[other]);
            (to - from) / (end - start).max(1.0e-6)
        };
        idx == 0 || idx == last || velocity(idx - 1, idx).distance(velocity(idx, idx + 1)) > LEAST_BEND
    };
    let kept: Vec<(f32, Vec3)> = (0..places.len()).filter(|idx| turns(*idx)).map(|idx| places[idx]).collect();
    let stride = kept.len().div_ceil(MAX_KEYS).max(1);
    let last = kept.len().saturating_sub(1);
    kept.into_iter()
        .enumerate()
        .filter(|(idx, _)| idx.is_multiple_of(stride) || *idx == last)
        .map(|(_, it)| it)
        .collect()
}

/// Indices of the places that matter: all others lie within `slack` metres of the straight lines between them (Douglas
/// and Peucker 1973).
fn simplified(places: &[(f32, Vec3)], slack: f32) -> Vec<usize> {
    let mut kept = vec![false; places.len()];
    let last = places.len() - 1;
    (kept[0], kept[last]) = (true, true);
    let mut open = vec![(0, last)];
    while let Some((from, to)) = open.pop() {
        let (a, b) = (places[from].1, places[to].1);
        let distance = |idx: &usize| distance_to_segment(places[*idx].1, a, b);
        let farthest = (from + 1..to).max_by(|one, other| distance(one).total_cmp(&distance(other)));
        if let Some(idx) = farthest.filter(|idx| distance(idx) > slack) {
            kept[idx] = true;
            open.extend([(from, idx), (idx, to)]);
        }
    }
    (0..places.len()).filter(|&idx| kept[idx]).collect()
}

/// The stops of one way, of a journey that may lead there and back.
fn one_way(places: impl Iterator<Item = Vec3>) -> Vec<Vec3> {
    let mut stops: Vec<Vec3> = Vec::new();
    for place in places {
        if stops.last().is_none_or(|last| last.distance(place) > SAME_M) {
            stops.push(place);
        }
    }
    let count = stops.len();
    if count < 3 || stops[0].distance(stops[count - 1]) > SAME_M {
        return stops;
    }
    let is_mirrored = (0..count).all(|idx| stops[idx].distance(stops[count - 1 - idx]) <= SAME_M);
    stops.truncate(if is_mirrored { count.div_ceil(2) } else { count - 1 });
    stops
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shifts(heights: &[(f32, f32)]) -> Animation {
        Animation { shifts: heights.iter().map(|(at, y)| (*at, Vec3::Y * *y)).collect(), ..Animation::default() }
    }

    #[test]
    fn a_lift_there_and_back_has_two_stops_however_finely_it_was_sampled() {
        let sampled: Vec<(f32, f32)> = (0..=200)
            .map(|frame| {
                let at = frame as f32 * 0.05;
                // Up for 3 s, 2 s above, down for 3 s, 2 s below.
                let height = if at < 5.0 { (at / 3.0).min(1.0) } else { (1.0 - (at - 5.0) / 3.0).max(0.0) };
                (at, 6.0 * height)
            })
            .collect();
        let coarse = [(0.0, 0.0), (3.0, 6.0), (5.0, 6.0), (8.0, 0.0), (10.0, 0.0)];
        for keys in [&sampled[..], &coarse[..]] {
            let journey = shifts(keys).journey(|shift| shift).expect("it moves");
            assert_eq!((journey.begin, journey.path.len()), (Vec3::ZERO, 1), "{journey:?}");
            assert!((journey.path[0].y - 6.0).abs() < 0.01 && (journey.travel_s - 3.0).abs() < 0.11, "{journey:?}");
        }
        assert_eq!(shifts(&coarse).journey(|shift| shift).expect("it moves").dwell_s, 2.0);
    }

    #[test]
    fn a_node_that_stays_has_no_journey_and_a_winding_one_no_more_stops_than_a_mover_may_have() {
        assert_eq!(shifts(&[(0.0, 1.0), (2.0, 1.01)]).journey(|shift| shift), None);
        assert_eq!(Animation::default().journey(|shift| shift), None);
        let winding = (0..400).map(|idx| (idx as f32 * 0.1, Vec3::new(idx as f32 * 0.1, (idx % 7) as f32, 0.0)));
        let winding = Animation { shifts: winding.collect(), ..Animation::default() };
        assert!(winding.journey(|shift| shift).expect("it moves").path.len() < MAX_STOPS);
    }

    #[test]
    fn a_swing_goes_from_the_first_angle_to_the_farthest() {
        let swing = |turns: &[(f32, f32)]| Animation { turns: turns.to_vec(), ..Animation::default() }.swing();
        assert_eq!(swing(&[(0.0, 0.0), (1.0, -1.5), (4.0, -1.5), (5.0, 0.0)]).map(|(turn, _)| turn), Some(-1.5));
        assert_eq!(swing(&[(0.0, 0.0), (1.0, 0.1)]), None);
    }
}
