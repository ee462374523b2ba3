//! Path queries, and the plans that answer them.

use crate::evidence::Evidence;
use crate::ids::{EdgeKey, LegKey};
use crate::legs::LegModel;
use crate::needs::Needs;
use crate::price::{AbilityPrices, Caution};
use crate::zones::{Tags, Zones};
use surefoot_world::{Ability, AbilitySet, Chance, Decisions, Seconds, StopSet, Vec3};

/// How start and goal are joined to the graph.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, strum::IntoStaticStr)]
#[strum(serialize_all = "lowercase")]
pub enum Attach {
    /// To several near vertices each; the plan with the lowest total cost wins. Without a path, the plan leads to the
    /// reachable vertex nearest to the goal.
    #[default]
    Several,
    /// To the nearest vertex each, as in the paper. Without a path, the plan heads straight for the goal.
    Nearest,
}

impl Attach {
    /// Lower-case name, as in commands.
    pub fn name(self) -> &'static str {
        self.into()
    }
}

/// A path query.
#[derive(Debug, Clone, PartialEq)]
pub struct Query {
    /// Where the path begins, m.
    pub start: Vec3,
    /// Where the path ends, m.
    pub goal: Vec3,
    /// Legs that the plan must not use.
    pub avoid: Vec<LegKey>,
    /// Abilities that the plan must not use.
    pub without: AbilitySet,
    /// What the plan pays for abilities, in addition to their time.
    pub prices: AbilityPrices,
    /// How far the plan goes to keep the NPC alive.
    pub caution: Caution,
    /// The stops at which each mover of the map stands sooner or later; empty if all movers stand at all stops. See
    /// [`all_stops_ahead`](crate::needs::all_stops_ahead).
    pub stops: Vec<StopSet>,
    /// How start and goal are joined to the graph.
    pub attach: Attach,
    /// Zones that the plan respects.
    pub zones: Zones,
    /// The tags of the NPC, for zones that ask for them.
    pub tags: Tags,
}

impl Query {
    /// A query for a careful plan that may use all abilities.
    pub fn new(start: Vec3, goal: Vec3) -> Self {
        let (avoid, prices, stops, zones, tags) = Default::default();
        Self {
            start,
            goal,
            avoid,
            without: AbilitySet::default(),
            prices,
            caution: Caution::CAREFUL,
            stops,
            attach: Attach::Several,
            zones,
            tags,
        }
    }

    /// Whether the query asks for a careful plan without restrictions other than zones: such plans can be looked up.
    pub(crate) fn is_usual(&self) -> bool {
        let allows_all = self.avoid.is_empty() && self.without.is_empty() && self.stops.is_empty();
        allows_all && self.prices.is_empty() && self.caution == Caution::CAREFUL
    }
}

/// Share of a plan's risk, as the logarithm of its chance, that remains with rehearsals. Fitted to five bodies on
/// twelve levels, and checked on validation maps.
const LEFT_BY_REHEARSALS: f64 = 0.12;
/// Share of the failures on a leg that neither rehearsals nor further plans repair. Fitted like the above.
const LOST_BY_FAILING: f64 = 0.02;
/// Share of the deaths on a leg that neither rehearsals nor further plans prevent. Twice that of failures: no NPC died.
const LOST_BY_DYING: f64 = 0.04;

/// One leg of a plan.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Leg {
    /// The stops where the leg begins and ends.
    pub key: LegKey,
    /// Expected duration, including what failures cost.
    pub seconds: Seconds,
    /// Estimated chance of success.
    pub chance: Chance,
    /// Estimated chance of dying on the leg, at most `1 - chance`.
    pub death_chance: f32,
    /// The most demanding ability that the leg needs.
    pub ability: Ability,
}

/// Why there is no path.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NoPath {
    /// No vertex near the start has an edge that leaves it.
    StartOffGraph,
    /// No vertex near the goal has an edge that reaches it.
    GoalOffGraph,
    /// No path joins the islands of start and goal in either direction.
    DifferentIslands,
    /// A path leads from the goal to the start, but none from the start to the goal.
    OneWay,
    /// The goal is in a zone that the plan must not enter.
    GoalInZone,
}

/// The answer to a query: waypoints in order, and the legs that lead to them. The last waypoint is the goal or,
/// without a path, as near to it as paths lead.
#[derive(Debug, Clone, PartialEq)]
pub struct Plan {
    /// Positions, m; leg `i` ends at waypoint `i`.
    pub waypoints: Vec<Vec3>,
    /// Legs, one for each waypoint.
    pub legs: Vec<Leg>,
    /// Why there is no path; `None` if there is one.
    pub no_path: Option<NoPath>,
    /// The mover requirements of legs that have any, by the index of the leg, in ascending order.
    pub needs: Vec<(usize, Needs)>,
    /// Without a path: position of the reachable vertex nearest to the goal, m, to which the plan leads. `None` if no
    /// vertex is reachable; the plan is then a single leg straight to the goal. If zones bar that leg, this is the
    /// start, and the plan stays there.
    pub nearest: Option<Vec3>,
}

impl Plan {
    /// Returns the plan of one unproved leg straight to `goal`, m, without an estimate of its risk.
    pub fn straight(goal: Vec3) -> Self {
        let leg = Leg::lasting(LegKey::DIRECT, Decisions(1.0), Chance::new(1.0), 0.0, Ability::WALK);
        Self { waypoints: vec![goal], legs: vec![leg], no_path: None, needs: Vec::new(), nearest: None }
    }

    /// Returns the mover requirements of leg `leg`; `None` if it has none.
    pub fn needs_of(&self, leg: usize) -> Option<&Needs> {
        self.needs.binary_search_by_key(&leg, |(leg, _)| *leg).ok().map(|at| &self.needs[at].1)
    }

    /// Returns the expected duration of all legs, including what failures cost.
    pub fn seconds(&self) -> Seconds {
        self.legs.iter().map(|leg| leg.seconds).sum()
    }

    /// Returns the estimated chance of dying on the way, for an NPC that does not rehearse.
    pub fn death_chance(&self) -> f64 {
        1.0 - self.legs.iter().map(|leg| 1.0 - f64::from(leg.death_chance)).product::<f64>()
    }

    /// Returns the estimated chance that an NPC that rehearses its legs arrives by this plan, without making another
    /// one.
    pub fn as_planned_chance(&self) -> Chance {
        Chance::new(libm::pow(self.chance().get(), LEFT_BY_REHEARSALS))
    }

    /// Returns the estimated chance that an NPC arrives that rehearses its legs and makes another plan if a leg fails.
    pub fn arrival_chance(&self) -> Chance {
        let kept = |leg: &Leg| {
            let death = f64::from(leg.death_chance);
            1.0 - LOST_BY_FAILING * (1.0 - leg.chance.get() - death) - LOST_BY_DYING * death
        };
        Chance::new(self.legs.iter().map(kept).product())
    }

    /// Returns the estimated chance that every leg succeeds, for an NPC that does not rehearse.
    pub fn chance(&self) -> Chance {
        self.legs.iter().map(|leg| leg.chance).product()
    }
}

impl Leg {
    /// Creates the leg along a proved edge.
    pub(crate) fn proved(key: EdgeKey, evidence: &Evidence) -> Self {
        let (chance, death_chance) = (evidence.chance(), evidence.death_chance());
        Self::lasting(key.into(), evidence.decisions_mean(), chance, death_chance, evidence.ability)
    }

    /// Creates an unproved leg, which `model` estimates from the positions of its two ends, m.
    pub(crate) fn unproved(model: &LegModel, key: LegKey, [start, end]: [Vec3; 2]) -> Self {
        let estimate = model.estimate(start, end);
        Self::lasting(key, estimate.decisions, estimate.chance, estimate.death_chance, Ability::WALK)
    }

    fn lasting(key: LegKey, decisions: Decisions, chance: Chance, death_chance: f64, ability: Ability) -> Self {
        let seconds = Decisions(decisions.0 / chance.get()).seconds();
        Self { key, seconds, chance, death_chance: death_chance as f32, ability }
    }
}
