//! Live evidence: traversals that have been reported since edges were proved, by reporter.
//!
//! Reports of trusted reporters count in full. Reports of all other reporters together count at most half as many
//! tries as the edge's own probes: they can raise a cost, but never outweigh the proof.

use crate::evidence::{Evidence, TryEnd};
use crate::graph::{Edge, NavGraph};
use crate::ids::EdgeKey;
use crate::price::EdgeCost;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Number of tries of an edge, of all trusted or of all other reporters, at which these tries are halved in weight,
/// so that recent tries can change the estimate.
pub const MEMORY: u32 = 64;
/// Maximum number of reporters with an entry of their own; further ones share the entry [`OTHERS`].
const MAX_REPORTERS: usize = 64;
/// Name of the entry that all further reporters share.
const OTHERS: &str = "(others)";
/// Tries of probes for each try that reporters without trust may add to an edge.
const PROBES_FOR_EACH: u32 = 2;

/// A traversal of an edge.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Traversal {
    /// The edge.
    pub edge: EdgeKey,
    /// How it ended.
    pub end: TryEnd,
    /// Number of decisions.
    pub decisions: u32,
}

/// A source of reported traversals.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub struct Reporter {
    /// Name, unique among the reporters that are trusted and among those that are not.
    pub name: String,
    /// Whether the traversals count in full.
    pub is_trusted: bool,
}

/// The traversals of a reporter, counted.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Reported {
    /// The reporter.
    pub reporter: Reporter,
    /// Number of traversals that are remembered.
    pub traversals: u64,
    /// Number of these that failed.
    pub failures: u64,
}

/// Traversals of one edge by one reporter, as sums; the sums of several planners add up.
#[derive(Debug, Clone, PartialEq)]
pub struct Counts {
    /// The source of the reports.
    pub reporter: Reporter,
    /// The edge.
    pub edge: EdgeKey,
    /// Numbers of traversals, of those that arrived, and of those that ended in death.
    pub tries: [u32; 3],
    /// Sums of the decisions of those that arrived, and of the squares of these.
    pub decisions: [f64; 2],
}

impl Counts {
    /// The sums of one traversal.
    pub fn of(reporter: &Reporter, traversal: &Traversal) -> Self {
        let arrived = traversal.end == TryEnd::Arrived;
        let decisions = if arrived { f64::from(traversal.decisions) } else { 0.0 };
        Self {
            reporter: reporter.clone(),
            edge: traversal.edge,
            tries: [1, u32::from(arrived), u32::from(traversal.end == TryEnd::Died)],
            decisions: [decisions, decisions * decisions],
        }
    }
}

/// Evidence from traversals, by reporter and edge.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct LiveEvidence {
    reporters: BTreeMap<Reporter, BTreeMap<EdgeKey, Evidence>>,
}

impl LiveEvidence {
    /// Returns whether there are no traversals.
    pub fn is_empty(&self) -> bool {
        self.reporters.is_empty()
    }

    /// Adds a traversal of an edge of `graph`. Returns the new cost of the edge; `None` if `graph` has no such edge.
    pub fn note(&mut self, graph: &NavGraph, reporter: &Reporter, traversal: &Traversal) -> Option<EdgeCost> {
        let edge = graph.edge(traversal.edge)?;
        let is_trusted = reporter.is_trusted;
        let own = self.entry(reporter).entry(edge.key).or_default();
        own.note(traversal.end, traversal.decisions, edge.evidence.ability);
        if self.sum(edge.key, is_trusted).tries >= MEMORY {
            self.halve(edge.key, is_trusted);
        }
        Some(self.added_to(edge).edge_cost())
    }

    /// Returns evidence that was counted elsewhere. Reporters beyond the limit share an entry. Counts that contradict
    /// each other are left out.
    pub fn of_counts(counts: impl IntoIterator<Item = Counts>) -> Self {
        let mut live = Self::default();
        counts.into_iter().for_each(|counts| live.add(&counts));
        live
    }

    /// Adds traversals that were counted, unless the counts contradict each other.
    pub fn add(&mut self, Counts { reporter, edge, tries, decisions }: &Counts) {
        let counted = Evidence::counted(*tries, *decisions);
        if !counted.is_consistent() {
            return;
        }
        let own = self.entry(reporter).entry(*edge).or_default();
        *own = own.combined(&counted);
        while self.sum(*edge, reporter.is_trusted).tries >= MEMORY {
            self.halve(*edge, reporter.is_trusted);
        }
    }

    /// Replaces the evidence by evidence that was counted elsewhere. Edges with a vertex whose index is `count` or
    /// higher keep theirs: layers add these edges, and only this planner has them.
    pub fn renew(&mut self, counted: Self, count: usize) {
        let is_of_layer = |key: &EdgeKey| key.from.idx() >= count || key.to.idx() >= count;
        let old = std::mem::replace(self, counted);
        for (reporter, edges) in old.reporters {
            let kept: Vec<_> = edges.into_iter().filter(|(key, _)| is_of_layer(key)).collect();
            if !kept.is_empty() {
                self.entry(&reporter).extend(kept);
            }
        }
    }

    /// Returns all edges with evidence, some of them more than once.
    pub fn edges(&self) -> impl Iterator<Item = EdgeKey> {
        self.reporters.values().flat_map(|edges| edges.keys().copied())
    }

    /// Returns the cost of an edge of `graph`; `None` if `graph` has no such edge.
    pub fn cost(&self, graph: &NavGraph, edge: EdgeKey) -> Option<EdgeCost> {
        graph.edge(edge).map(|edge| self.added_to(edge).edge_cost())
    }

    /// Returns the entry of a reporter, which may be one that several share.
    fn entry(&mut self, reporter: &Reporter) -> &mut BTreeMap<EdgeKey, Evidence> {
        let has_entry = self.reporters.contains_key(reporter) || self.reporters.len() < MAX_REPORTERS;
        let shared = || Reporter { name: OTHERS.to_owned(), is_trusted: reporter.is_trusted };
        self.reporters.entry(if has_entry { reporter.clone() } else { shared() }).or_default()
    }

    /// Halves the weight of all trusted or of all other tries of an edge.
    fn halve(&mut self, edge: EdgeKey, is_trusted: bool) {
        let alike = self.reporters.iter_mut().filter(|(other, _)| other.is_trusted == is_trusted);
        alike.filter_map(|(_, edges)| edges.get_mut(&edge)).for_each(Evidence::halve);
    }

    /// Returns the sum of the evidence of an edge, of all trusted or of all other reporters.
    fn sum(&self, edge: EdgeKey, is_trusted: bool) -> Evidence {
        let alike = self.reporters.iter().filter(|(reporter, _)| reporter.is_trusted == is_trusted);
        alike.filter_map(|(_, edges)| edges.get(&edge)).fold(Evidence::default(), |sum, own| sum.combined(own))
    }

    /// Returns the evidence of an edge with all reports added at their weight.
    fn added_to(&self, edge: &Edge) -> Evidence {
        let mut others = self.sum(edge.key, false);
        others.limit_tries(edge.evidence.tries / PROBES_FOR_EACH);
        edge.evidence.combined(&self.sum(edge.key, true)).combined(&others)
    }

    /// Returns `graph` with the live evidence added to its edges. Evidence of edges that `graph` does not have is
    /// ignored.
    pub fn apply_to(&self, graph: &NavGraph) -> NavGraph {
        let mut data = graph.to_data();
        for edge in &mut data.edges {
            // A sum is unsound only if it overflows; the edge then keeps the evidence of its probes.
            let both = self.added_to(edge);
            edge.evidence = if both.is_sound() { both } else { edge.evidence };
        }
        NavGraph::check(data).expect("sound evidence was added to a checked graph")
    }

    /// Returns whether the values can have come from traversals.
    pub fn is_sound(&self) -> bool {
        let mut tries: BTreeMap<(bool, EdgeKey), u32> = BTreeMap::new();
        for (reporter, edges) in &self.reporters {
            for (&edge, evidence) in edges {
                let sum = tries.entry((reporter.is_trusted, edge)).or_default();
                *sum = sum.saturating_add(evidence.tries);
                if !evidence.is_consistent() {
                    return false;
                }
            }
        }
        // Beyond the limit, there can be one shared entry of trusted reporters and one of all others.
        self.reporters.len() <= MAX_REPORTERS + 2 && tries.values().all(|&sum| sum < MEMORY)
    }

    /// Removes the evidence of edges with a vertex whose index is `count` or higher.
    pub fn keep_below(&mut self, count: usize) {
        for edges in self.reporters.values_mut() {
            edges.retain(|key, _| key.from.idx() < count && key.to.idx() < count);
        }
        self.reporters.retain(|_, edges| !edges.is_empty());
    }

    /// Returns the number of traversals of trusted reporters that count; halving reduces it.
    pub fn traversals(&self) -> u64 {
        self.reports().iter().filter(|report| report.reporter.is_trusted).map(|report| report.traversals).sum()
    }

    /// Returns the counted traversals of each reporter, by name.
    pub fn reports(&self) -> Vec<Reported> {
        let reported = |(reporter, edges): (&Reporter, &BTreeMap<EdgeKey, Evidence>)| Reported {
            reporter: reporter.clone(),
            traversals: edges.values().map(|evidence| u64::from(evidence.tries)).sum(),
            failures: edges.values().map(|evidence| u64::from(evidence.tries - evidence.successes)).sum(),
        };
        self.reporters.iter().map(reported).collect()
    }

    /// Removes all traversals that a reporter of this name reported. Returns their number.
    pub fn drop_reports(&mut self, name: &str) -> u64 {
        let of_name = |report: &&Reported| report.reporter.name == name;
        let dropped = self.reports().iter().filter(of_name).map(|report| report.traversals).sum();
        self.reporters.retain(|reporter, _| reporter.name != name);
        dropped
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn sums_of_several_planners_are_the_evidence_of_one() {
        let reporter = |name: &str, is_trusted| Reporter { name: name.to_owned(), is_trusted };
        let ends = [TryEnd::Arrived, TryEnd::Failed, TryEnd::Arrived, TryEnd::Died];
        let traversal = |idx: u32| Traversal {
            edge: EdgeKey::new(idx % 3, 3),
            end: ends[idx as usize % ends.len()],
            decisions: 5 + idx,
        };
        let reports: Vec<(Reporter, Traversal)> =
            (0..60).map(|idx| (reporter(["a", "b"][idx as usize % 2], idx % 5 > 0), traversal(idx))).collect();
        let counts = |reports: &[(Reporter, Traversal)]| -> Vec<Counts> {
            reports.iter().map(|(reporter, traversal)| Counts::of(reporter, traversal)).collect()
        };
        let whole = LiveEvidence::of_counts(counts(&reports));
        assert!(whole.is_sound() && whole.reports().iter().map(|report| report.traversals).sum::<u64>() == 60);
        let (first, second) = reports.split_at(23);
        let other_order = LiveEvidence::of_counts(counts(second).into_iter().chain(counts(first)));
        assert_eq!(whole, other_order);
        // Counts that contradict each other are left out, and many of one edge are halved.
        let made_up = Counts { tries: [1, 2, 0], ..Counts::of(&reports[0].0, &reports[0].1) };
        assert!(LiveEvidence::of_counts([made_up]).traversals() == 0);
        let many = Counts { tries: [1000, 500, 10], decisions: [5e3, 5e4], ..Counts::of(&reports[1].0, &reports[1].1) };
        assert!(LiveEvidence::of_counts([many]).is_sound());
    }

    #[test]
    fn evidence_of_edges_that_layers_add_stays() {
        let reporter = Reporter { name: "a".to_owned(), is_trusted: true };
        let on = |edge| Counts::of(&reporter, &Traversal { edge, end: TryEnd::Failed, decisions: 1 });
        let (proved, added) = (EdgeKey::new(0, 1), EdgeKey::new(1, 7));
        let mut live = LiveEvidence::of_counts([on(proved), on(proved), on(added)]);
        live.renew(LiveEvidence::of_counts([on(proved)]), 5);
        assert_eq!(live, LiveEvidence::of_counts([on(proved), on(added)]));
    }

    fn graph() -> NavGraph {
        let edge = |from: u32, tries: u32| {
            let mut evidence = Evidence::default();
            (0..tries).for_each(|_| evidence.note(TryEnd::Arrived, 10, surefoot_world::Ability::WALK));
            Edge { key: EdgeKey::new(from, from + 1), evidence }
        };
        let vertices = (0..4_u8).map(|idx| surefoot_world::Vec3::new(30.0 * f32::from(idx), 0.0, 0.0)).collect();
        let edges = vec![edge(0, 1), edge(1, 8), edge(2, 40)];
        NavGraph::check(crate::graph::GraphData { vertices, edges, ..crate::graph::GraphData::default() }).unwrap()
    }

    /// Reports as (reporter, whether it is trusted, edge, end, decisions); the last edge is none of the graph.
    fn reports() -> impl Strategy<Value = Vec<(u8, bool, u32, TryEnd, u32)>> {
        let end = prop::sample::select(vec![TryEnd::Arrived, TryEnd::Failed, TryEnd::Died]);
        let decisions = prop_oneof![9 => 1..90u32, 1 => Just(u32::MAX)];
        prop::collection::vec((any::<u8>(), any::<bool>(), 0..4u32, end, decisions), 0..400)
    }

    proptest! {
        #![proptest_config(crate::properties::cases(100))]

        #[test]
        fn evidence_stays_sound_and_strangers_count_half_as_much_as_probes(reports in reports()) {
            let graph = graph();
            let mut live = LiveEvidence::default();
            // By edge: all trusted reports, which count one by one until there are too many to remember.
            let mut trusted: BTreeMap<EdgeKey, Evidence> = BTreeMap::new();
            for (name, is_trusted, from, end, decisions) in reports {
                let reporter = Reporter { name: format!("reporter {name}"), is_trusted };
                let traversal = Traversal { edge: EdgeKey::new(from, from + 1), end, decisions };
                let cost = live.note(&graph, &reporter, &traversal);
                prop_assert_eq!(cost.is_some(), graph.edge(traversal.edge).is_some());
                prop_assert_eq!(cost, live.cost(&graph, traversal.edge));
                if cost.is_some() && is_trusted {
                    trusted.entry(traversal.edge).or_default().note(end, decisions, surefoot_world::Ability::WALK);
                }
            }
            prop_assert!(live.is_sound() && live.reports().len() <= MAX_REPORTERS + 2);
            prop_assert_eq!(&crate::store::decode_live(&crate::store::encode_live(&live)).unwrap(), &live);
            let applied = live.apply_to(&graph);
            for edge in graph.edges() {
                let both = applied.edge(edge.key).unwrap().evidence;
                prop_assert_eq!(Some(both.edge_cost()), live.cost(&graph, edge.key));
                let all = trusted.get(&edge.key).copied().unwrap_or_default();
                if all.tries < MEMORY {
                    let others = both.tries - edge.evidence.tries - all.tries;
                    prop_assert!(others <= edge.evidence.tries / PROBES_FOR_EACH);
                    prop_assert!(both.successes >= edge.evidence.successes + all.successes);
                }
            }
            // Without the reports, the graph is what it was.
            let names: Vec<String> = live.reports().into_iter().map(|report| report.reporter.name).collect();
            names.iter().for_each(|name| _ = live.drop_reports(name));
            prop_assert!(live.is_empty());
            prop_assert_eq!(live.apply_to(&graph).to_data(), graph.to_data());
        }
    }

    #[test]
    fn counts_that_overflow_are_left_out() {
        let reporter = Reporter { name: "a".to_owned(), is_trusted: true };
        let one = Counts::of(&reporter, &Traversal { edge: EdgeKey::new(0, 1), end: TryEnd::Arrived, decisions: 9 });
        for decisions in [[1.0e300, 81.0], [9.0, 1.0e300], [f64::NAN, 81.0], [-1.0, 1.0]] {
            let live = LiveEvidence::of_counts([one.clone(), Counts { decisions, ..one.clone() }, one.clone()]);
            assert_eq!((live.traversals(), live.is_sound()), (2, true), "{decisions:?}");
        }
    }
}
