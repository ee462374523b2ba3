//! Places to ask about, on a floor that a wall divides.

use std::sync::Arc;
use surefoot_planner::graph::GraphData;
use surefoot_planner::places::{Around, Sight};
use surefoot_planner::{Edge, EdgeKey, NavGraph};
use surefoot_world::map::mover::cuboid;
use surefoot_world::map::{MapSize, Placed};
use surefoot_world::mesh::{Surface, Triangle};
use surefoot_world::{CharacterProfile, Decisions, Map, Vec3};

/// A floor of 60 x 60 m at a height of 1 m, with a wall 4 m high across it at x = 30, and water over its south.
fn map() -> Arc<Map> {
    let floor = cuboid(Vec3::ZERO, Vec3::new(60.0, 1.0, 60.0));
    let wall = cuboid(Vec3::new(29.5, 1.0, 0.0), Vec3::new(30.5, 5.0, 50.0));
    let solid = floor.into_iter().chain(wall).filter_map(|corners| Triangle::new(corners, Surface::Ground));
    let water = [Vec3::new(0.0, 2.0, 55.0), Vec3::new(60.0, 2.0, 55.0), Vec3::new(30.0, 2.0, 60.0)];
    let triangles = solid.chain(Triangle::new(water, Surface::Water)).collect();
    Arc::new(Map::from_parts(MapSize { width: 60, height: 20, depth: 60 }, triangles, Placed::default()))
}

/// A vertex every 10 m, each with an edge to the next.
fn graph() -> NavGraph {
    let vertices: Vec<Vec3> = (0..25)
        .map(|idx| Vec3::new(10.0 + (idx % 5) as f32 * 10.0 + 2.0, 1.0, 10.0 + (idx / 5) as f32 * 10.0))
        .collect();
    let edge = |from| Edge {
        key: EdgeKey::new(from, from + 1),
        evidence: surefoot_planner::evidence::Evidence::forced(Decisions(9.0)),
    };
    NavGraph::check(GraphData { vertices, edges: (0..24).map(edge).collect(), ..GraphData::default() }).unwrap()
}

#[test]
fn places_are_the_nearest_vertices_and_then_ground_near_them() {
    let (map, graph, body) = (map(), graph(), CharacterProfile::default());
    let centre = Vec3::new(22.0, 1.0, 30.0);
    let few = Around { centre, radius_m: 15.0, most: 4 }.draw(&graph, &map, &body);
    assert_eq!(few.len(), 4);
    assert!(few.iter().all(|place| graph.positions().contains(place)));
    assert!(few.is_sorted_by(|one, other| one.distance(centre) <= other.distance(centre)));
    let many = Around { centre, radius_m: 15.0, most: 60 }.draw(&graph, &map, &body);
    assert_eq!(many, Around { centre, radius_m: 15.0, most: 60 }.draw(&graph, &map, &body));
    assert!(many.starts_with(&few) && many.len() > 40, "{} places", many.len());
    for (idx, place) in many.iter().enumerate() {
        assert!(place.distance(centre) <= 15.5 && (place.y - 1.0).abs() < 0.1, "{place}");
        assert!((place.x - 30.0).abs() > 0.5, "{place} is in the wall");
        assert!(graph.positions().iter().any(|vertex| vertex.distance(*place) <= 6.5));
        assert!(many[..idx].iter().all(|other| other.distance(*place) > 1.2), "{place} is close to another");
    }
    let nothing = Around { centre: Vec3::new(22.0, 90.0, 30.0), radius_m: 15.0, most: 60 }.draw(&graph, &map, &body);
    assert_eq!(nothing, []);
}

#[test]
fn a_wall_hides_what_is_behind_it() {
    let map = map();
    let [west, east, beyond_the_end] = [(20.0, 30.0), (40.0, 30.0), (40.0, 58.0)].map(|(x, z)| Vec3::new(x, 2.5, z));
    let hidden = Sight { hidden_from: vec![west], sees: Vec::new() };
    let seen = Sight { hidden_from: Vec::new(), sees: vec![west] };
    assert!(hidden.fits(map.mesh(), east) && !seen.fits(map.mesh(), east));
    let corner = Vec3::new(20.0, 2.5, 58.0);
    assert!(!Sight { hidden_from: vec![corner], sees: Vec::new() }.fits(map.mesh(), beyond_the_end));
    assert!(Sight { hidden_from: vec![west], sees: vec![beyond_the_end] }.fits(map.mesh(), east));
    assert!(!Sight { hidden_from: vec![west, beyond_the_end], sees: Vec::new() }.fits(map.mesh(), east));
    // Above the wall, and at the eye itself.
    assert!(seen.fits(map.mesh(), east.with_y(9.0)) && seen.fits(map.mesh(), west));
    // The surface of water hides nothing.
    let [below, above] = [1.5, 2.5].map(|y| Sight { hidden_from: Vec::new(), sees: vec![Vec3::new(29.0, y, 57.0)] });
    let diver = Vec3::new(33.0, 1.2, 57.0);
    assert!(below.fits(map.mesh(), diver) && above.fits(map.mesh(), diver));
    assert!(Sight::default().is_free() && Sight::default().fits(map.mesh(), east));
}
