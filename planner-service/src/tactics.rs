//! Questions about many places at a time: which are best, and which are reached in time.

use crate::error::PlannerError;
use crate::hosted::Hosted;
use crate::planner::Planner;
use std::sync::atomic::Ordering;
use surefoot_planner::places::{Around, Sight};
use surefoot_planner::search::many::{Arrival, RankBy, SharedEnd, best};
use surefoot_planner::search::reach::{MAX_CELLS, ReachedCell, ReachedVertex};
use surefoot_planner::{NoPath, Query};
use surefoot_world::sense::eye_height;
use surefoot_world::{Seconds, Vec3};

/// Which of many places are best.
#[derive(Debug)]
pub struct RankQuestion {
    /// Start or goal of all plans, and what they may use.
    pub query: Query,
    pub shared: SharedEnd,
    pub places: Vec<Vec3>,
    pub around: Option<Around>,
    pub sight: Sight,
    /// Height of the eyes of a body at a place above its feet, m; `None`: as the body's size has it.
    pub eye_height: Option<f32>,
    pub by: RankBy,
    /// Greatest number of places in the answer.
    pub most: usize,
}

impl RankQuestion {
    /// Checks that all places lie in the map or near it.
    pub fn check_inside(&self, hosted: &Hosted) -> Result<(), PlannerError> {
        let check = |places: &[Vec3], field| places.iter().try_for_each(|&place| hosted.check_inside(place, field));
        let end = if self.shared == SharedEnd::Start { "query.start" } else { "query.goal" };
        hosted.check_inside(self.query.start, end)?;
        check(&self.places, "places")?;
        self.around.iter().try_for_each(|around| hosted.check_inside(around.centre, "around.centre"))?;
        check(&self.sight.hidden_from, "hidden_from")?;
        check(&self.sight.sees, "sees")
    }
}

/// A place, its index among those that were considered, and what its plan promises.
#[derive(Debug)]
pub struct RankedPlace {
    pub idx: usize,
    pub place: Vec3,
    pub arrival: Result<Arrival, NoPath>,
}

/// The best places, and how many there were.
#[derive(Debug)]
pub struct Ranking {
    pub places: Vec<RankedPlace>,
    pub considered: usize,
    pub fitting: usize,
}

/// What is reached from where, and in which time.
#[derive(Debug)]
pub struct ReachQuestion {
    /// The start, and what the paths may use.
    pub query: Query,
    pub limit: Seconds,
    /// Side of the cells, m; `None` without cells.
    pub side_m: Option<f32>,
}

/// What is reached.
#[derive(Debug)]
pub struct Reach {
    /// Vertices and their positions, m.
    pub vertices: Vec<(ReachedVertex, Vec3)>,
    pub cells: Vec<ReachedCell>,
}

impl Planner {
    /// Ranks places. May make the map: call this from a thread that may block.
    pub fn rank_places(&self, hosted: &Hosted, question: &RankQuestion) -> Ranking {
        let places = self.fitting_places(hosted, question);
        let at: Vec<Vec3> = places.fitting.iter().map(|(_, place)| *place).collect();
        self.plans.fetch_add(at.len() as u64, Ordering::Relaxed);
        let arrivals =
            hosted.with_router(|router, costs| router.arrivals(&question.query, question.shared, &at, costs));
        let ranked = best(&arrivals, question.by, question.most).into_iter().map(|rank| {
            let (idx, place) = places.fitting[rank];
            RankedPlace { idx, place, arrival: arrivals[rank] }
        });
        Ranking { places: ranked.collect(), considered: places.considered, fitting: places.fitting.len() }
    }

    /// The places that are hidden or in sight as the question asks, given ones first.
    fn fitting_places(&self, hosted: &Hosted, question: &RankQuestion) -> Places {
        let RankQuestion { places, around, sight, .. } = question;
        let mut places = places.clone();
        // Only these two need the map.
        if around.is_some() || !sight.is_free() {
            let (map, body) = (self.maps.get(&hosted.origin.source), &hosted.origin.body);
            places.extend(around.iter().flat_map(|around| hosted.with_graph(|graph| around.draw(graph, &map, body))));
            let eyes = Vec3::Y * question.eye_height.unwrap_or_else(|| eye_height(body));
            let fits = |(_, place): &(usize, Vec3)| sight.fits(map.mesh(), *place + eyes);
            return Places { considered: places.len(), fitting: places.into_iter().enumerate().filter(fits).collect() };
        }
        Places { considered: places.len(), fitting: places.into_iter().enumerate().collect() }
    }

    /// Finds what an NPC reaches.
    pub fn reachable(&self, hosted: &Hosted, question: &ReachQuestion) -> Result<Reach, PlannerError> {
        let ReachQuestion { query, limit, side_m } = question;
        hosted.with_router(|router, costs| {
            let vertices = router.reachable(query, *limit, costs);
            let cells =
                side_m.map_or(Some(Vec::new()), |side_m| router.reached_cells(query, &vertices, *limit, side_m));
            let position = |reached: ReachedVertex| (reached, router.graph().position(reached.vertex));
            Ok(Reach {
                cells: cells.ok_or(PlannerError::TooManyCells(MAX_CELLS))?,
                vertices: vertices.into_iter().map(position).collect(),
            })
        })
    }
}

/// Places with their indices among those that were considered.
#[derive(Debug)]
struct Places {
    considered: usize,
    fitting: Vec<(usize, Vec3)>,
}
