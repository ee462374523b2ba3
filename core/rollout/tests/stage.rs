//! Maps of boxes, and plans on maps.

use std::sync::Arc;
use surefoot_planner::{BuildSettings, Progress, Router};
use surefoot_policy::Policy;
use surefoot_rollout::ProbeContext;
use surefoot_rollout::graphs::build;
use surefoot_world::map::mover::cuboid;
use surefoot_world::map::{MapSize, Placed};
use surefoot_world::mesh::{Surface, Triangle};
use surefoot_world::{Map, Vec3};

/// A map of solid boxes, each given by its lowest and its highest corner, m.
pub fn of_boxes(size: MapSize, boxes: impl IntoIterator<Item = [Vec3; 2]>) -> Arc<Map> {
    let faces = boxes.into_iter().flat_map(|[low, high]| cuboid(low, high));
    let triangles = faces.filter_map(|corners| Triangle::new(corners, Surface::Ground)).collect();
    Arc::new(Map::from_parts(size, triangles, Placed::default()))
}

/// Plans of the default body and policy on a graph of so many vertices.
pub fn router(map: &Arc<Map>, vertices: usize) -> Router {
    let context = ProbeContext::new(map.clone(), Policy::shipped().unwrap());
    let settings = BuildSettings::default().with(|it| it.vertices = vertices).unwrap();
    Router::new(build(&context, &settings, 2, &Progress::default()).unwrap().graph, 300, 2)
}
