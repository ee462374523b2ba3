//! The proved graph: positions, directed edges with their evidence, islands.

use crate::candidates::Candidate;
use crate::legs::LegModel;
use crate::probe::Outcome;
use petgraph::Direction;
use petgraph::algo::kosaraju_scc;
use petgraph::graph::{DiGraph, NodeIndex};
use serde::{Deserialize, Serialize};
use surefoot_world::Vec3;
use surefoot_world::character::TickEvents;

/// The most demanding thing that a leg takes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default, Serialize, Deserialize)]
pub enum Ability {
    /// Walking, sliding, dropping.
    #[default]
    Walk,
    /// A jump from the ground.
    Jump,
    /// A second jump in the air.
    DoubleJump,
    /// A jump pad.
    Pad,
    /// A zip line.
    ZipLine,
    /// A teleporter.
    Teleporter,
    /// A jetpack's thrust.
    Jetpack,
}

impl Ability {
    /// All abilities, from the least demanding on.
    pub const ALL: [Ability; 7] = [
        Ability::Walk,
        Ability::Jump,
        Ability::DoubleJump,
        Ability::Pad,
        Ability::ZipLine,
        Ability::Teleporter,
        Ability::Jetpack,
    ];

    /// The ability behind what a body did.
    pub fn used(events: TickEvents) -> Self {
        if events.thrust {
            Ability::Jetpack
        } else if events.teleported {
            Ability::Teleporter
        } else if events.zipped {
            Ability::ZipLine
        } else if events.padded {
            Ability::Pad
        } else if events.double_jumped {
            Ability::DoubleJump
        } else if events.jumped {
            Ability::Jump
        } else {
            Ability::Walk
        }
    }

    /// Lower-case name.
    pub fn name(self) -> &'static str {
        match self {
            Ability::Walk => "walk",
            Ability::Jump => "jump",
            Ability::DoubleJump => "double_jump",
            Ability::Pad => "pad",
            Ability::ZipLine => "zip_line",
            Ability::Teleporter => "teleporter",
            Ability::Jetpack => "jetpack",
        }
    }
}

/// What probing an edge showed.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Evidence {
    /// Probes run.
    pub tries: u32,
    /// Probes that arrived.
    pub successes: u32,
    /// Sum of the decisions of those that arrived.
    decisions_sum: f64,
    /// Sum of their squares.
    decisions_squared: f64,
    /// Ability used by the least demanding probe that arrived.
    pub ability: Ability,
    /// Chance of success that was expected before the first probe, in [0, 1]; it counts as much as one probe.
    pub prior: f32,
    /// Factor on the price, where a designer set one; 1 otherwise.
    pub price_factor: f32,
    /// Corners of the box around all ways taken, m; the lower is above the upper where there were none.
    pub bounds: [Vec3; 2],
}

impl Default for Evidence {
    fn default() -> Self {
        Self {
            tries: 0,
            successes: 0,
            decisions_sum: 0.0,
            decisions_squared: 0.0,
            ability: Ability::Walk,
            prior: UNKNOWN_PRIOR,
            price_factor: 1.0,
            bounds: [Vec3::splat(f32::MAX), Vec3::splat(f32::MIN)],
        }
    }
}

/// Expected chance of a candidate of which nothing is known; high, because candidates are near one another.
const UNKNOWN_PRIOR: f32 = 0.9;

impl Evidence {
    /// Adds one probe with the way that it took.
    pub fn note_probe(&mut self, outcome: &Outcome) {
        self.note(outcome.reached, outcome.decisions, outcome.ability);
        outcome.bounds.into_iter().for_each(|corner| self.cover(corner));
    }

    /// These tries and others of the same edge; ability and prior stay.
    pub fn and(&self, other: &Evidence) -> Self {
        Self {
            tries: self.tries.saturating_add(other.tries),
            successes: self.successes.saturating_add(other.successes),
            decisions_sum: self.decisions_sum + other.decisions_sum,
            decisions_squared: self.decisions_squared + other.decisions_squared,
            ..*self
        }
    }

    /// Lets everything count half.
    pub fn halve(&mut self) {
        let kept = self.successes / 2;
        let share = f64::from(kept) / f64::from(self.successes.max(1));
        self.tries = kept + (self.tries - self.successes) / 2;
        self.successes = kept;
        self.decisions_sum *= share;
        self.decisions_squared *= share;
    }

    /// Widens the bounds so that they hold `point`.
    pub fn cover(&mut self, point: Vec3) {
        self.bounds = [self.bounds[0].min(point), self.bounds[1].max(point)];
    }

    /// Adds one probe.
    pub fn note(&mut self, reached: bool, decisions: u32, ability: Ability) {
        self.tries += 1;
        if !reached {
            return;
        }
        self.ability = if self.successes == 0 { ability } else { self.ability.min(ability) };
        self.successes += 1;
        self.decisions_sum += f64::from(decisions);
        self.decisions_squared += f64::from(decisions).powi(2);
    }

    /// Share of probes that arrived, in [0, 1].
    pub fn success_rate(&self) -> f64 {
        f64::from(self.successes) / f64::from(self.tries.max(1))
    }

    /// Estimated chance of success, above 0, at most 1: tries pulled towards the prior.
    pub fn chance(&self) -> f64 {
        let successes = f64::from(self.successes) + f64::from(self.prior);
        (successes / (f64::from(self.tries) + 1.0)).clamp(MIN_CHANCE, 1.0)
    }

    /// Mean decisions of probes that arrived.
    pub fn decisions_mean(&self) -> f64 {
        self.decisions_sum / f64::from(self.successes.max(1))
    }

    /// Standard deviation of those decisions.
    pub fn decisions_deviation(&self) -> f64 {
        let mean = self.decisions_mean();
        (self.decisions_squared / f64::from(self.successes.max(1)) - mean * mean).max(0.0).sqrt()
    }

    /// Whether its numbers can have come from probes that prove an edge.
    pub fn is_sound(&self) -> bool {
        self.successes > 0 && self.is_consistent()
    }

    /// Whether its numbers can have come from probes at all.
    pub fn is_consistent(&self) -> bool {
        self.successes <= self.tries
            && (0.0..=f64::MAX).contains(&self.decisions_sum)
            && (0.0..=f64::MAX).contains(&self.decisions_squared)
            && (0.0..=1.0).contains(&self.prior)
            && self.price_factor > 0.0
            && self.price_factor.is_finite()
            && self.bounds.iter().all(|corner| corner.is_finite())
    }

    /// Evidence of a leg that somebody vouches for: one success that took `decisions`.
    pub fn vouched(decisions: f64) -> Self {
        Self {
            tries: 1,
            successes: 1,
            decisions_sum: decisions,
            decisions_squared: decisions * decisions,
            prior: 1.0,
            ..Self::default()
        }
    }

    /// What a search minimises: the [price] of its decisions at its chance, times a designer's factor.
    pub fn cost(&self) -> f64 {
        f64::from(self.price_factor) * price(self.decisions_mean(), self.chance())
    }

    /// Whether enough tries succeeded for an edge.
    pub fn proves(&self, threshold: f64) -> bool {
        self.successes > 0 && self.success_rate() >= threshold
    }
}

/// Expected time of a leg in decisions, what is lost by failing included: tries until one succeeds, plus a price on
/// risk. Chances multiply along a plan, so their logarithms add.
pub fn price(decisions: f64, chance: f64) -> f64 {
    decisions / chance - RISK_DECISIONS * chance.ln()
}

/// Lowest chance that is told apart.
const MIN_CHANCE: f64 = 1.0e-3;
/// Decisions that a plan may last longer to avoid a leg that fails with probability 1 - 1/e.
const RISK_DECISIONS: f64 = 60.0;

/// A proved edge.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Edge {
    /// Index of the vertex it leaves.
    pub from: u32,
    /// Index of the vertex it reaches.
    pub to: u32,
    /// What probing showed.
    pub evidence: Evidence,
}

/// A checked graph: every edge joins two existing, different vertices.
#[derive(Debug, Clone)]
pub struct NavGraph {
    graph: DiGraph<Vec3, Edge>,
    legs: LegModel,
    islands: Vec<u32>,
    island_count: u32,
}

/// A graph as it is stored and sent, not yet checked.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct GraphData {
    /// Positions, m.
    pub vertices: Vec<Vec3>,
    /// Edges between them.
    pub edges: Vec<Edge>,
    /// Prices of legs that nobody has proved.
    pub legs: LegModel,
}

/// A stored graph that makes no sense.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum GraphError {
    /// An edge names a vertex that does not exist, or itself.
    #[error("edge {0} -> {1} does not join two of the graph's vertices")]
    BadEdge(u32, u32),
    /// A vertex has a position that is not finite.
    #[error("vertex {0} has no finite position")]
    BadVertex(usize),
    /// An edge's evidence contradicts itself.
    #[error("the evidence of edge {0} -> {1} makes no sense")]
    BadEvidence(u32, u32),
    /// The model of unproved legs has a coefficient that is not finite.
    #[error("the model of unproved legs has a coefficient that is not finite")]
    BadLegs,
}

impl NavGraph {
    /// Keeps the candidates whose success rate reaches `threshold`.
    ///
    /// # Panics
    /// If there is not one evidence per candidate.
    pub fn prove(vertices: Vec<Vec3>, candidates: &[Candidate], evidence: &[Evidence], threshold: f64) -> Self {
        assert_eq!(candidates.len(), evidence.len());
        let edges = candidates
            .iter()
            .zip(evidence)
            .filter(|(_, evidence)| evidence.proves(threshold))
            .map(|(&(from, to), &evidence)| Edge { from, to, evidence })
            .collect();
        let legs = LegModel::fit(&vertices, candidates, evidence);
        Self::check(GraphData { vertices, edges, legs }).expect("candidates join existing vertices")
    }

    /// Checks a stored graph.
    ///
    /// # Errors
    /// Names the first vertex or edge that makes no sense.
    pub fn check(data: GraphData) -> Result<Self, GraphError> {
        let mut graph = DiGraph::with_capacity(data.vertices.len(), data.edges.len());
        for (idx, vertex) in data.vertices.iter().enumerate() {
            if !vertex.is_finite() {
                return Err(GraphError::BadVertex(idx));
            }
            graph.add_node(*vertex);
        }
        for edge in data.edges {
            let inside = |idx: u32| (idx as usize) < data.vertices.len();
            if !inside(edge.from) || !inside(edge.to) || edge.from == edge.to {
                return Err(GraphError::BadEdge(edge.from, edge.to));
            }
            if !edge.evidence.is_sound() {
                return Err(GraphError::BadEvidence(edge.from, edge.to));
            }
            graph.add_edge(NodeIndex::new(edge.from as usize), NodeIndex::new(edge.to as usize), edge);
        }
        if !data.legs.is_finite() {
            return Err(GraphError::BadLegs);
        }
        // Not Tarjan's: petgraph has it recursive, and a long row of vertices would exhaust the stack.
        let components = kosaraju_scc(&graph);
        let mut islands = vec![0; graph.node_count()];
        for (island, members) in components.iter().enumerate() {
            for member in members {
                islands[member.index()] = island as u32;
            }
        }
        Ok(Self { graph, legs: data.legs, islands, island_count: components.len() as u32 })
    }

    /// The graph as plain data.
    pub fn to_data(&self) -> GraphData {
        GraphData {
            vertices: self.graph.node_weights().copied().collect(),
            edges: self.graph.edge_weights().copied().collect(),
            legs: self.legs,
        }
    }

    /// Prices of legs that nobody has proved.
    pub fn legs(&self) -> &LegModel {
        &self.legs
    }

    /// The petgraph behind it.
    pub fn as_petgraph(&self) -> &DiGraph<Vec3, Edge> {
        &self.graph
    }

    /// Vertices.
    pub fn vertex_count(&self) -> usize {
        self.graph.node_count()
    }

    /// Proved edges.
    pub fn edge_count(&self) -> usize {
        self.graph.edge_count()
    }

    /// Position of a vertex, m.
    pub fn position(&self, vertex: u32) -> Vec3 {
        self.graph[NodeIndex::new(vertex as usize)]
    }

    /// Edges that leave a vertex.
    pub fn edges_from(&self, vertex: u32) -> impl Iterator<Item = &Edge> {
        self.graph.edges(NodeIndex::new(vertex as usize)).map(|edge| edge.weight())
    }

    /// The edge between two vertices, if there is one.
    pub fn edge(&self, from: u32, to: u32) -> Option<&Edge> {
        let count = self.vertex_count() as u32;
        let edge = (from < count && to < count)
            .then(|| self.graph.find_edge(NodeIndex::new(from as usize), NodeIndex::new(to as usize)))??;
        self.graph.edge_weight(edge)
    }

    /// Whether any proved edge leaves a vertex.
    pub fn is_left(&self, vertex: u32) -> bool {
        self.edges_from(vertex).next().is_some()
    }

    /// Whether any proved edge reaches a vertex.
    pub fn is_reached(&self, vertex: u32) -> bool {
        self.graph.edges_directed(NodeIndex::new(vertex as usize), Direction::Incoming).next().is_some()
    }

    /// All edges.
    pub fn edges(&self) -> impl Iterator<Item = &Edge> {
        self.graph.edge_weights()
    }

    /// Strongly connected components.
    pub fn island_count(&self) -> u32 {
        self.island_count
    }

    /// Island of each vertex.
    pub fn islands(&self) -> &[u32] {
        &self.islands
    }

    /// Vertices that can be reached from `from`, itself included.
    pub fn reachable_from(&self, from: u32) -> Vec<bool> {
        let mut seen = vec![false; self.vertex_count()];
        let mut stack = vec![from];
        seen[from as usize] = true;
        while let Some(vertex) = stack.pop() {
            for edge in self.edges_from(vertex) {
                if !std::mem::replace(&mut seen[edge.to as usize], true) {
                    stack.push(edge.to);
                }
            }
        }
        seen
    }

    /// Share of ordered pairs of different vertices with a path, in [0, 1].
    pub fn connected_share(&self) -> f64 {
        let count = self.vertex_count();
        let pairs: usize =
            (0..count as u32).map(|from| self.reachable_from(from).iter().filter(|&&seen| seen).count() - 1).sum();
        pairs as f64 / (count * count.saturating_sub(1)).max(1) as f64
    }
}
