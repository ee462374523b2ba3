//! Questions about many places at a time.

use super::{Figure, median, timed, timed_with};
use std::hint::black_box;
use surefoot_planner::places::{Around, Sight};
use surefoot_planner::search::many::SharedEnd;
use surefoot_planner::{AbilitySet, Caution, EdgeCosts, Query, Router};
use surefoot_rollout::ProbeContext;
use surefoot_world::sense::eye_height;
use surefoot_world::{Ability, Seconds, Vec3};

/// Number of places of a question.
const PLACES: usize = 1000;
/// Number of questions, each from another place.
const QUESTIONS: usize = 20;
/// Greatest time per place, us.
const MOST_US: f64 = 50.0;

/// What questions cost per place, on a graph of 1,600 vertices.
pub fn figures(router: &Router, context: &ProbeContext, points: &[Vec3]) -> Vec<Figure> {
    let (places, here) = (&points[..PLACES], &points[PLACES..PLACES + QUESTIONS]);
    let per_place = |question: &dyn Fn(Vec3)| median(here.iter().map(|&at| timed(|| question(at)) * 1.0e6).collect());
    let rank = |name, change: &dyn Fn(&mut Query), shared, places: &[Vec3]| {
        let us = per_place(&|at| {
            let mut query = Query::new(at, at);
            change(&mut query);
            black_box(router.arrivals(&query, shared, places, &EdgeCosts::new()));
        });
        Figure::new(name, us / places.len() as f64, "us").at_most(MOST_US)
    };
    let on_foot = |query: &mut Query| query.without = AbilitySet::from_iter([Ability::JUMP]);
    let out_of_reach: Vec<Vec3> = places.iter().map(|place| *place + Vec3::Y * 100.0).collect();
    let mut figures = vec![
        rank("rank_from_us", &|_| {}, SharedEnd::Start, places),
        rank("rank_to_us", &|_| {}, SharedEnd::Goal, places),
        rank("rank_on_foot_from_us", &on_foot, SharedEnd::Start, places),
        rank("rank_on_foot_to_us", &on_foot, SharedEnd::Goal, places),
        rank("rank_bold_from_us", &|query| query.caution = Caution::BOLD, SharedEnd::Start, places),
        rank("rank_bold_to_us", &|query| query.caution = Caution::BOLD, SharedEnd::Goal, places),
        rank("rank_out_of_reach_us", &|_| {}, SharedEnd::Start, &out_of_reach),
    ];
    let eyes = Vec3::Y * eye_height(&context.profile);
    let sight_us = per_place(&|at| {
        let sight = Sight { hidden_from: vec![at + eyes], sees: Vec::new() };
        black_box(places.iter().filter(|place| sight.fits(context.map.mesh(), **place + eyes)).count());
    });
    figures.push(Figure::new("sight_us", sight_us / PLACES as f64, "us").at_most(MOST_US));
    let around = Around { centre: points[PLACES], radius_m: 200.0, most: PLACES };
    let (drawn, seconds) = timed_with(|| around.draw(router.graph(), &context.map, &context.profile));
    figures.push(Figure::new("draw_us", seconds * 1.0e6 / drawn.len().max(1) as f64, "us").at_most(MOST_US));
    let reach_us = per_place(&|at| {
        let (query, limit) = (Query::new(at, at), Seconds(20.0));
        let reached = router.reachable(&query, limit, &EdgeCosts::new());
        black_box(router.reached_cells(&query, &reached, limit, 2.0));
    });
    figures.push(Figure::new("reachable_ms", reach_us / 1000.0, "ms"));
    figures
}
