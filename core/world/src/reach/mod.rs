//! Which places of a map a character can reach, by geometry and ballistics, without a policy.
//!
//! Three layers. [`ground`]: every place to stand on a fine grid, joined into *islands* by walking. [`leap`]: what
//! the character's body does when it runs off a ledge, jumps, or is thrown by a pad; each leap is simulated tick by
//! tick. This module: directed *links* between islands, each shown by a simulated leap or ride or by a mover beside both, and what they
//! connect.
//!
//! The result is conservative: a jump counts only where a scripted body made it.

mod borders;
pub mod ground;
pub mod leap;
pub(crate) mod links;
mod rides;
mod tries;

pub use borders::Cause;

use crate::character::CharacterProfile;
use crate::map::Map;
use ground::Ground;
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use serde::{Deserialize, Serialize};
use strum::VariantArray;
use tries::Tries;

/// What a character must do to follow a link between two islands.
#[derive(
    Debug,
    Clone,
    Copy,
    PartialEq,
    Eq,
    PartialOrd,
    Ord,
    Hash,
    Serialize,
    Deserialize,
    strum::VariantArray,
    strum::IntoStaticStr,
)]
#[serde(rename_all = "snake_case")]
#[strum(serialize_all = "snake_case")]
pub enum Means {
    /// Walking off a ledge.
    Drop,
    /// One jump.
    Jump,
    /// A second jump in the air.
    DoubleJump,
    /// A jump pad.
    Pad,
    /// A zip line.
    ZipLine,
    /// A teleporter.
    Teleporter,
    /// A jetpack.
    Jetpack,
    /// A lift or platform that is ridden, or a floor or conveyor that is walked over.
    Mover,
}

impl Means {
    /// All means, the least demanding first.
    pub const ALL: &[Means] = Self::VARIANTS;

    /// Lower-case name as used in reports.
    pub fn name(self) -> &'static str {
        self.into()
    }
}

/// A directed link from one island to another.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Link {
    /// Index of the island that the link leaves.
    pub from: u32,
    /// Index of the island that the link reaches.
    pub to: u32,
    /// What a character must do to follow the link.
    pub means: Means,
    /// Index of the cell where a character leaves the first island, or that is nearest to the device that takes it away.
    pub takeoff: u32,
    /// Index of the cell where it arrives.
    pub landing: u32,
}

/// The ground of a map with all links between its islands.
#[derive(Debug)]
pub struct Reach {
    /// Places to stand and the islands that they form.
    pub ground: Ground,
    /// Links between islands, sorted; at most one for each pair of islands and each means.
    pub links: Vec<Link>,
}

/// Random starts whose reachable share is averaged.
const START_COUNT: usize = 1000;

impl Reach {
    /// Surveys `map` for characters of `profile`, with jumps of up to 10 m; the result does not depend on `thread_count`.
    pub fn survey(map: &Map, profile: &CharacterProfile, thread_count: usize) -> Self {
        Self::survey_with(map, profile, thread_count, &Tries::usual())
    }

    /// Like [`survey`](Self::survey), but tries jumps as far and as high as the body may get, and more of them. Takes longer.
    pub fn survey_far(map: &Map, profile: &CharacterProfile, thread_count: usize) -> Self {
        Self::survey_with(map, profile, thread_count, &Tries::far(profile))
    }

    fn survey_with(map: &Map, profile: &CharacterProfile, thread_count: usize, tries: &Tries) -> Self {
        let ground = Ground::survey(map, profile, thread_count);
        let mut links = links::find(map, profile, &ground, thread_count, tries);
        links.extend(rides::links(map, profile, &ground));
        links.sort_unstable();
        Self { ground, links }
    }

    /// Share of ordered pairs of places that are connected on foot, without drops or jumps, in [0, 1].
    pub fn share_on_foot(&self) -> f64 {
        let total = self.ground.cells().len() as f64;
        self.ground.islands().iter().map(|island| f64::from(island.cell_count) / total).map(|share| share * share).sum()
    }

    /// Share of ordered pairs of places that are connected by links whose means are `usable`, in [0, 1], estimated from
    /// random starts; 0 if there is no place to stand.
    pub fn share_by(&self, usable: impl Fn(Means) -> bool) -> f64 {
        if self.ground.cells().is_empty() {
            return 0.0;
        }
        let regions = self.regions(usable);
        let mut rng = ChaCha8Rng::seed_from_u64(0);
        let cells = self.ground.cells();
        let mut known: Vec<Option<u64>> = vec![None; regions.cell_counts.len()];
        let mut sum = 0.0;
        for _ in 0..START_COUNT {
            let island = cells[rng.random_range(0..cells.len())].island;
            let region = regions.of_island[island as usize];
            let reached = *known[region as usize].get_or_insert_with(|| regions.cells_reachable_from(region));
            sum += reached as f64 / cells.len() as f64;
        }
        sum / START_COUNT as f64
    }

    /// For each island, the islands to which its links lead whose means are `usable`.
    pub fn exits(&self, usable: impl Fn(Means) -> bool) -> Vec<Vec<u32>> {
        let mut exits = vec![Vec::new(); self.ground.islands().len()];
        for link in self.links.iter().filter(|link| usable(link.means)) {
            exits[link.from as usize].push(link.to);
        }
        exits
    }

    /// Merges islands that can reach one another over links whose means are `usable`.
    pub fn regions(&self, usable: impl Fn(Means) -> bool) -> Regions {
        let islands = self.ground.islands();
        let forward = self.exits(usable);
        let (of_island, region_count) = strongly_connected(&forward);
        let mut cell_counts = vec![0u64; region_count];
        let mut exits = vec![Vec::new(); region_count];
        for (island, &region) in islands.iter().zip(&of_island) {
            cell_counts[region as usize] += u64::from(island.cell_count);
        }
        for (from, targets) in forward.iter().enumerate() {
            for &to in targets {
                let (from, to) = (of_island[from], of_island[to as usize]);
                if from != to {
                    exits[from as usize].push(to);
                }
            }
        }
        exits.iter_mut().for_each(|targets| {
            targets.sort_unstable();
            targets.dedup();
        });
        Regions { of_island, cell_counts, exits }
    }
}

/// Strongly connected regions of a [`Reach`].
#[derive(Debug)]
pub struct Regions {
    /// Region of each island.
    pub of_island: Vec<u32>,
    /// Number of cells in each region.
    pub cell_counts: Vec<u64>,
    /// For each region, the regions that it leads to directly.
    pub exits: Vec<Vec<u32>>,
}

impl Regions {
    /// The region with the most cells.
    pub fn largest(&self) -> u32 {
        (0..self.cell_counts.len() as u32).max_by_key(|&region| self.cell_counts[region as usize]).unwrap_or(0)
    }

    /// For each region, whether it can be reached from `start`; true for `start` itself.
    pub fn reachable_from(&self, start: u32) -> Vec<bool> {
        flood(&self.exits, start)
    }

    /// For each region, whether it can reach `goal`; true for `goal` itself.
    pub fn reaching(&self, goal: u32) -> Vec<bool> {
        let mut entrances = vec![Vec::new(); self.exits.len()];
        for (from, targets) in (0..).zip(&self.exits) {
            targets.iter().for_each(|&to| entrances[to as usize].push(from));
        }
        flood(&entrances, goal)
    }

    fn cells_reachable_from(&self, start: u32) -> u64 {
        let reached = self.reachable_from(start);
        self.cell_counts.iter().zip(reached).filter_map(|(&count, reached)| reached.then_some(count)).sum()
    }
}

/// For each node, whether the directed edges `exits` lead to it from `start`; true for `start` itself.
pub fn flood(exits: &[Vec<u32>], start: u32) -> Vec<bool> {
    let mut reached = vec![false; exits.len()];
    let mut open = vec![start];
    while let Some(node) = open.pop() {
        if !std::mem::replace(&mut reached[node as usize], true) {
            open.extend(&exits[node as usize]);
        }
    }
    reached
}

/// Tarjan's algorithm without recursion: the component of each node, and the number of components.
fn strongly_connected(exits: &[Vec<u32>]) -> (Vec<u32>, usize) {
    const NEW: u32 = u32::MAX;
    let node_count = exits.len();
    let (mut order, mut low) = (vec![NEW; node_count], vec![0u32; node_count]);
    let mut component = vec![NEW; node_count];
    let (mut next_order, mut component_count) = (0, 0);
    let (mut stack, mut calls): (Vec<u32>, Vec<(u32, usize)>) = (Vec::new(), Vec::new());
    for root in 0..node_count as u32 {
        if order[root as usize] != NEW {
            continue;
        }
        calls.push((root, 0));
        while let Some((node, exit_idx)) = calls.pop() {
            let n = node as usize;
            if exit_idx == 0 {
                order[n] = next_order;
                low[n] = next_order;
                next_order += 1;
                stack.push(node);
            }
            if let Some(&to) = exits[n].get(exit_idx) {
                calls.push((node, exit_idx + 1));
                if order[to as usize] == NEW {
                    calls.push((to, 0));
                } else if component[to as usize] == NEW {
                    low[n] = low[n].min(order[to as usize]);
                }
                continue;
            }
            if low[n] == order[n] {
                while let Some(member) = stack.pop() {
                    component[member as usize] = component_count;
                    if member == node {
                        break;
                    }
                }
                component_count += 1;
            }
            if let Some(&(parent, _)) = calls.last() {
                low[parent as usize] = low[parent as usize].min(low[n]);
            }
        }
    }
    (component, component_count as usize)
}
