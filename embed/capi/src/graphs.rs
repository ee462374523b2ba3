//! Graphs: plans, and what changes them while a game runs.
//!
//! Three things change the costs of a proved graph. Closed and priced edges, and reported traversals, take effect at
//! once. Designers' edits prepare the graph again.

use crate::abi::{self, COORDINATES_LEVEL, COORDINATES_MAP, STOP_GOAL, STOP_START};
use crate::error::{Fault, Status};
use std::collections::{BTreeMap, BTreeSet};
use std::ffi::c_char;
use std::sync::OnceLock;
use surefoot_planner::candidates::Candidate;
use surefoot_planner::edits::{Edit, FACTORS, Layer, Terrain, apply_layers};
use surefoot_planner::evidence::{Evidence, TryEnd};
use surefoot_planner::export::{frame_of, import_json};
use surefoot_planner::live::{LiveEvidence, Reporter, Traversal};
use surefoot_planner::price::{EdgeCost, EdgeCosts, price};
use surefoot_planner::search::DEFAULT_LABEL_LIMIT;
use surefoot_planner::{
    AbilitySet, Caution, EdgeKey, Leg, LegKey, NavGraph, NoPath, Plan, Query, Router, Stop, VertexId,
};
use surefoot_world::character::OwnMove;
use surefoot_world::map::LevelFrame;
use surefoot_world::{Ability, Decisions, Vec3};

/// Name under which the game reports.
const REPORTER: &str = "game";
/// Most plans of one query.
pub const MAX_PLANS: usize = 64;

/// `sf_graph`: a proved graph, ready for queries.
#[derive(Debug)]
pub struct Graph {
    /// The graph as it was loaded.
    proved: NavGraph,
    router: Router,
    closed: BTreeSet<EdgeKey>,
    factors: BTreeMap<EdgeKey, f32>,
    live: LiveEvidence,
    /// Costs of edges that were reported.
    reported: EdgeCosts,
    /// Costs of all edges that differ from the router's.
    repriced: EdgeCosts,
    /// Edges that designers' edits forbid.
    forbidden: BTreeSet<EdgeKey>,
    /// The graph without closed edges, which shows what is reachable; made when there is no path.
    open: OnceLock<Router>,
    /// How the level's own coordinates relate to the map's, if the file says so.
    frame: Option<LevelFrame>,
    /// Whether the caller's places are in the level's own coordinates; there is a frame then.
    is_in_level: bool,
}

impl Graph {
    /// Reads a graph from `surefoot graph export --format json`.
    pub fn parse(text: &str) -> Result<Self, Fault> {
        let proved = import_json(text).map_err(|error| Fault::file(error.to_string()))?;
        let router = Router::new(proved.clone(), DEFAULT_LABEL_LIMIT, 1);
        Ok(Self {
            proved,
            router,
            closed: BTreeSet::new(),
            factors: BTreeMap::new(),
            live: LiveEvidence::default(),
            reported: EdgeCosts::new(),
            repriced: EdgeCosts::new(),
            forbidden: BTreeSet::new(),
            open: OnceLock::new(),
            frame: frame_of(text),
            is_in_level: false,
        })
    }

    /// How the level's own coordinates relate to the map's.
    pub fn frame(&self) -> Result<&LevelFrame, Fault> {
        let missing = "the file of the graph does not say where its level lies: export it again from the level";
        self.frame.as_ref().ok_or_else(|| Fault::new(Status::NotFound, missing))
    }

    /// Sets the coordinates of the caller's places.
    pub fn set_coordinates(&mut self, coordinates: i32) -> Result<(), Fault> {
        self.is_in_level = match coordinates {
            COORDINATES_MAP => false,
            COORDINATES_LEVEL => self.frame().map(|_| true)?,
            _ => return Err(Fault::argument(format!("coordinates is {coordinates}, but must be 0 or 1"))),
        };
        Ok(())
    }

    /// The frame of the caller's places; `None` if they are in the coordinates of the map.
    pub fn frame_of_places(&self) -> Option<&LevelFrame> {
        self.frame.as_ref().filter(|_| self.is_in_level)
    }

    /// The graph with edits, but without closed edges, prices and reports.
    pub fn graph(&self) -> &NavGraph {
        self.router.graph()
    }

    /// All edges with their current costs.
    pub fn edges(&self) -> Vec<abi::Edge> {
        let edge = |edge: &surefoot_planner::Edge| abi::Edge {
            key: abi::LegKey { from: edge.key.from.0, to: edge.key.to.0 },
            ability: u8::from(edge.evidence.ability).into(),
            is_open: (!self.closed.contains(&edge.key)).into(),
            seconds: (edge.evidence.decisions_mean().0 / edge.evidence.chance().get()) as f32
                * surefoot_world::DECISION_SECONDS,
            chance: edge.evidence.chance().get() as f32,
            death_chance: edge.evidence.death_chance() as f32,
            cost: self.repriced.get(&edge.key).map_or(edge.evidence.cost() as f32, |cost| cost.careful),
        };
        self.graph().edges().map(edge).collect()
    }

    /// The edge between two vertices.
    fn edge(&self, from: u32, to: u32) -> Result<(EdgeKey, EdgeCost), Fault> {
        let key = EdgeKey::new(from, to);
        let missing =
            || Fault::new(Status::NotFound, format!("the graph has no edge from vertex {from} to vertex {to}"));
        self.graph().edge(key).map(|edge| (key, edge.evidence.edge_cost())).ok_or_else(missing)
    }

    /// Opens or closes an edge.
    pub fn set_open(&mut self, from: u32, to: u32, is_open: bool) -> Result<(), Fault> {
        let (key, _) = self.edge(from, to)?;
        if is_open {
            self.closed.remove(&key)
        } else {
            self.closed.insert(key)
        };
        self.reprice(key);
        self.forbid();
        Ok(())
    }

    /// Sets the factor on the cost of an edge.
    pub fn set_price(&mut self, from: u32, to: u32, factor: f32) -> Result<(), Fault> {
        let (key, _) = self.edge(from, to)?;
        if !FACTORS.contains(&factor) {
            return Err(Fault::argument(format!("factor is {factor}, but must be 0.1 to 1000; close edges instead")));
        }
        if factor == 1.0 {
            self.factors.remove(&key)
        } else {
            self.factors.insert(key, factor)
        };
        self.reprice(key);
        Ok(())
    }

    /// Adds a traversal to the evidence of an edge.
    pub fn note(&mut self, traversal: &abi::Traversal) -> Result<(), Fault> {
        let abi::Traversal { key: abi::LegKey { from, to }, decisions, end } = *traversal;
        let (edge, _) = self.edge(from, to)?;
        let end = match end {
            0 => TryEnd::Arrived,
            1 => TryEnd::Failed,
            2 => TryEnd::Died,
            _ => return Err(Fault::argument(format!("traversal.end is {end}, but must be 0, 1 or 2"))),
        };
        let reporter = Reporter { name: REPORTER.to_owned(), is_trusted: true };
        let cost = self.live.note(self.router.graph(), &reporter, &Traversal { edge, end, decisions });
        self.reported.extend(cost.map(|cost| (edge, cost)));
        self.reprice(edge);
        Ok(())
    }

    /// Computes the current cost of an edge.
    fn reprice(&mut self, key: EdgeKey) {
        let reported = self.reported.get(&key).copied();
        let factor = self.factors.get(&key).copied();
        let proved = self.graph().edge(key).map(|edge| edge.evidence.edge_cost());
        if self.closed.contains(&key) {
            self.repriced.insert(key, EdgeCost { careful: f32::INFINITY, by_death: 0.0 });
        } else if let Some(cost) = reported.or(proved).filter(|_| reported.is_some() || factor.is_some()) {
            let factor = factor.unwrap_or(1.0);
            let cost = EdgeCost { careful: factor * cost.careful, by_death: factor * cost.by_death };
            self.repriced.insert(key, cost);
        } else {
            self.repriced.remove(&key);
        }
        self.open = OnceLock::new();
    }

    /// Prevents unproved legs from replacing closed or forbidden edges.
    fn forbid(&mut self) {
        let barred: Vec<EdgeKey> = self.closed.union(&self.forbidden).copied().collect();
        self.router.forbid(barred);
    }

    /// Replaces all designers' edits, and resets closed edges, prices and reports.
    pub fn edit(&mut self, edits: &[abi::Edit]) -> Result<(), Fault> {
        let edits = edits.iter().enumerate().map(|(idx, edit)| self.read_edit(idx, edit)).collect::<Result<_, _>>()?;
        let layer = Layer { name: REPORTER.to_owned(), edits };
        layer.validate().map_err(|error| Fault::argument(error.to_string()))?;
        let edited = apply_layers(&self.proved, std::slice::from_ref(&layer), 0.0, &NoTerrain);
        let edited = edited.expect("edits of edges take no probes");
        if let Some(first) = edited.unapplied.first() {
            let reason = first.reason.describe(&self.frame_of_places().copied().unwrap_or_default());
            return Err(Fault::new(Status::NotFound, format!("edit {}: {reason}", first.index)));
        }
        self.router = Router::new(edited.graph, DEFAULT_LABEL_LIMIT, 1);
        self.forbidden = edited.forbidden;
        (self.closed, self.factors, self.live) = Default::default();
        (self.reported, self.repriced) = Default::default();
        self.open = OnceLock::new();
        self.forbid();
        Ok(())
    }

    fn read_edit(&self, idx: usize, edit: &abi::Edit) -> Result<Edit, Fault> {
        let frame = self.frame_of_places();
        let from = edit.from.on_map(frame, format_args!("edits[{idx}].from"))?;
        let to = || edit.to.on_map(frame, format_args!("edits[{idx}].to"));
        match edit.kind {
            1 => Ok(Edit::ForbidEdge { from, to: to()? }),
            2 => Ok(Edit::ForceEdge { from, to: to()?, seconds: (edit.value >= 0.0).then_some(edit.value) }),
            3 => Ok(Edit::PriceEdge { from, to: to()?, factor: edit.value }),
            4 => Ok(Edit::RemoveVertex { at: from }),
            kind => {
                Err(Fault::argument(format!("edits[{idx}].kind is {kind}: it must be one of sf_edit_kind, 1 to 4")))
            }
        }
    }

    /// The query of a caller, with the legs to avoid.
    pub fn query(&self, query: &abi::Query, avoid: &[abi::LegKey]) -> Result<Query, Fault> {
        let frame = self.frame_of_places();
        let (start, goal) = (query.start.on_map(frame, "query.start")?, query.goal.on_map(frame, "query.goal")?);
        let avoid = avoid.iter().map(|key| LegKey { from: stop(key.from), to: stop(key.to) }).collect();
        let (without, caution) = (abilities(query.without)?, caution(query.caution)?);
        Ok(Query { avoid, without, caution, ..Query::new(start, goal) })
    }

    /// Finds the cheapest plan.
    pub fn find(&self, query: &Query) -> Plan {
        let plan = self.router.find_path_at(query, &self.repriced);
        if plan.no_path.is_none() || self.closed.is_empty() {
            return plan;
        }
        // The router does not know which edges are closed.
        let open = self.open.get_or_init(|| {
            let mut data = self.graph().to_data();
            data.edges.retain(|edge| !self.closed.contains(&edge.key));
            let graph = NavGraph::check(data).expect("a checked graph with fewer edges");
            let mut router = Router::new(graph, 0, 1);
            router.forbid(self.closed.union(&self.forbidden).copied().collect());
            router
        });
        open.find_path_at(query, &self.repriced)
    }

    /// Finds up to `most` plans, the cheapest first: the cheapest of all, and plans without one of its legs.
    pub fn find_several(&self, query: &Query, most: usize) -> Vec<Plan> {
        let best = self.find(query);
        if best.no_path.is_some() || most <= 1 {
            return vec![best];
        }
        let keys = |plan: &Plan| plan.legs.iter().map(|leg| leg.key).collect::<Vec<LegKey>>();
        let mut seen = BTreeSet::from([keys(&best)]);
        let mut others = Vec::new();
        for leg in &best.legs {
            let avoid = query.avoid.iter().copied().chain([leg.key]).collect();
            let plan = self.find(&Query { avoid, ..query.clone() });
            if plan.no_path.is_none() && seen.insert(keys(&plan)) {
                others.push(plan);
            }
        }
        let cost = |plan: &Plan| plan.legs.iter().map(|leg| cost_of(leg, query.caution)).sum::<f64>();
        others.sort_by(|one, other| cost(one).total_cmp(&cost(other)));
        std::iter::once(best).chain(others).take(most).collect()
    }
}

/// The cost of a leg in a plan, in decisions.
fn cost_of(leg: &Leg, caution: Caution) -> f64 {
    let decisions = Decisions(leg.seconds.decisions().0 * leg.chance.get());
    price(decisions, leg.chance, leg.death_chance.into(), caution)
}

/// A terrain without places and probes: edits by vertex need neither.
struct NoTerrain;

impl Terrain for NoTerrain {
    fn stand(&self, _: Vec3) -> Option<Vec3> {
        None
    }

    fn prove(&self, _: &[Vec3], candidates: &[Candidate]) -> Option<Vec<Evidence>> {
        Some(vec![Evidence::default(); candidates.len()])
    }
}

/// The stop with this number.
fn stop(number: u32) -> Stop {
    match number {
        STOP_START => Stop::Start,
        STOP_GOAL => Stop::Goal,
        vertex => Stop::Vertex(VertexId(vertex)),
    }
}

fn stop_number(stop: Stop) -> u32 {
    match stop {
        Stop::Start => STOP_START,
        Stop::Goal => STOP_GOAL,
        Stop::Vertex(VertexId(vertex)) => vertex,
    }
}

/// The name of an ability of a body with these moves, and what a game plays meanwhile.
pub fn describe_ability(moves: &[OwnMove], ability: Ability) -> Result<abi::AbilityInfo, Fault> {
    let own = ability.own_idx().map(|idx| moves.get(idx));
    let (name, animation) = match own {
        None => (ability.name(), ability.name()),
        Some(Some(own)) => (own.id.as_str(), own.animation()),
        Some(None) => {
            let message = format!("the body has {} moves of its own: ability {} is none", moves.len(), ability.idx());
            return Err(Fault::new(Status::NotFound, message));
        }
    };
    Ok(abi::AbilityInfo { struct_size: 0, name: text(name), animation: text(animation) })
}

/// A text that ends with a zero.
fn text<const LEN: usize>(text: &str) -> [c_char; LEN] {
    let mut chars = [0; LEN];
    // The last one stays zero.
    chars.iter_mut().zip(text.bytes()).take(LEN - 1).for_each(|(to, byte)| *to = byte as c_char);
    chars
}

/// The abilities in a sum of bits.
pub fn abilities(bits: u32) -> Result<AbilitySet, Fault> {
    let all = (0..u32::BITS as usize).filter_map(Ability::at);
    let known = all.clone().skip(1).fold(0, |known, ability| known | 1 << ability.idx());
    if bits & !known != 0 {
        let message =
            format!("without is {bits}: it has bits that are not an sf_ability_bit; walking cannot be excluded");
        return Err(Fault::argument(message));
    }
    Ok(all.filter(|ability| bits & 1 << ability.idx() != 0).collect())
}

/// The caution with this number.
pub fn caution(number: f32) -> Result<Caution, Fault> {
    Caution::new(number).ok_or_else(|| Fault::argument(format!("caution is {number}, but must be 0 to 1")))
}

/// The legs of a plan, with places in the coordinates of a level with this frame, or else of the map.
pub fn legs(plan: &Plan, frame: Option<&LevelFrame>) -> impl Iterator<Item = abi::Leg> {
    plan.legs.iter().zip(&plan.waypoints).map(move |(leg, waypoint)| abi::Leg {
        waypoint: abi::Vec3::of_map(*waypoint, frame),
        key: abi::LegKey { from: stop_number(leg.key.from), to: stop_number(leg.key.to) },
        ability: u8::from(leg.ability).into(),
        seconds: leg.seconds.0,
        chance: leg.chance.get() as f32,
        death_chance: leg.death_chance,
    })
}

/// A whole plan, whose legs begin at `first_leg`.
pub fn summary(plan: &Plan, first_leg: usize) -> abi::Plan {
    abi::Plan {
        first_leg: first_leg as u32,
        leg_count: plan.legs.len() as u32,
        seconds: plan.seconds().0,
        chance: plan.chance().get() as f32,
        arrival_chance: if plan.no_path.is_some() { 0.0 } else { plan.arrival_chance().get() as f32 },
        death_chance: plan.death_chance() as f32,
        no_path: match plan.no_path {
            None => 0,
            Some(NoPath::StartOffGraph) => 1,
            Some(NoPath::GoalOffGraph) => 2,
            Some(NoPath::DifferentIslands) => 3,
            Some(NoPath::OneWay) => 4,
            Some(NoPath::GoalInZone) => 5,
        },
        leads_near: plan.nearest.is_some().into(),
    }
}
