//! Maps of boxes, and plans on maps.

use std::sync::Arc;
use surefoot_planner::{BuildSettings, Progress, Router};
use surefoot_policy::Policy;
use surefoot_rollout::ProbeContext;
use surefoot_rollout::graphs::build;
use surefoot_world::map::mover::cuboid;
use surefoot_world::map::{MapSize, Placed};
use surefoot_world::mesh::{Surface, Triangle};
use surefoot_world::{CharacterProfile, Map, Vec3};

/// A map of solid boxes, each given by its lowest and its highest corner, m.
pub fn of_boxes(size: MapSize, boxes: impl IntoIterator<Item = [Vec3; 2]>) -> Arc<Map> {
    of_surfaces(size, boxes.into_iter().map(|corners| (corners, Surface::Ground)))
}

/// The same with boxes of these surfaces.
pub fn of_surfaces(size: MapSize, boxes: impl IntoIterator<Item = ([Vec3; 2], Surface)>) -> Arc<Map> {
    let of_box = |([low, high], surface): ([Vec3; 2], Surface)| {
        cuboid(low, high).into_iter().filter_map(move |corners| Triangle::new(corners, surface))
    };
    Arc::new(Map::from_parts(size, boxes.into_iter().flat_map(of_box).collect(), Placed::default()))
}

/// Plans of the default body and policy on a graph of so many vertices.
pub fn router(map: &Arc<Map>, vertices: usize) -> Router {
    router_of(map, CharacterProfile::default(), vertices)
}

/// Plans of a body on such a graph.
pub fn router_of(map: &Arc<Map>, profile: CharacterProfile, vertices: usize) -> Router {
    let context = ProbeContext { profile, ..ProbeContext::new(map.clone(), Policy::shipped().unwrap()) };
    let settings = BuildSettings::default().with(|it| it.vertices = vertices).unwrap();
    Router::new(build(&context, &settings, 2, &Progress::default()).unwrap().graph, 300, 2)
}
