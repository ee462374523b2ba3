//! Compares rays and contacts of the mesh with parry's.

use crate::stage::cases;
use parry3d::query::{self, Ray, RayCast};
use parry3d::shape::{Capsule, FeatureId, TriMesh, Triangle as ParryTriangle};
use proptest::prelude::*;
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, OnceLock};
use surefoot_world::character::{MoveScratch, is_clear};
use surefoot_world::map::Features;
use surefoot_world::mesh::{Surface, Triangle};
use surefoot_world::sense::{RAY_COUNT, RayCone};
use surefoot_world::{Action, Body, CharacterProfile, Map, MapSpec, NpcSlot, TaskConfig, Vec3, World, navigable};

fn map() -> &'static (Map, TriMesh) {
    static MAP: OnceLock<(Map, TriMesh)> = OnceLock::new();
    MAP.get_or_init(|| {
        let map = surefoot_generate::generate(&MapSpec::with_side(21, 80).unwrap());
        let corners: Vec<Vec3> = map.mesh().triangles().iter().flat_map(Triangle::corners).collect();
        let indices = (0..corners.len() as u32 / 3).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
        let mesh = TriMesh::new(corners, indices).unwrap();
        (map, mesh)
    })
}

fn unit() -> impl Strategy<Value = Vec3> {
    (-1.0..1.0f32, -1.0..1.0f32, -1.0..1.0f32)
        .prop_filter("not too short", |(x, y, z)| x * x + y * y + z * z > 0.01)
        .prop_map(|(x, y, z)| Vec3::new(x, y, z).normalize())
}

proptest! {
    #![proptest_config(cases(3000))]

    #[test]
    fn rays_hit_where_parry_says(x in 0.0..80.0f32, y in 1.0..79.0f32, z in 0.0..80.0f32, direction in unit()) {
        let (map, reference) = map();
        let origin = Vec3::new(x, y, z);
        let ours = map.mesh().cast_ray(origin, direction, 30.0).map(|hit| hit.distance);
        let theirs = reference.cast_local_ray(&Ray::new(origin, direction), 30.0, false);
        match (ours, theirs) {
            (Some(ours), Some(theirs)) => prop_assert!((ours - theirs).abs() < 2.0e-2, "{ours} against {theirs}"),
            (None, None) => {}
            // The seams of our triangles overlap a little where parry's may leak, and rays that graze an edge
            // may pass on either side of the edge; our hit must still lie on a triangle.
            (Some(ours), None) => {
                let point = origin + direction * ours;
                let distance = map.mesh().triangles().iter().map(|triangle| {
                    let [a, b, c] = triangle.corners();
                    query::PointQuery::distance_to_local_point(&ParryTriangle::new(a, b, c), point, true)
                }).fold(f32::INFINITY, f32::min);
                prop_assert!(distance < 1.0e-2, "a hit {distance} m beside every triangle");
            }
            (None, Some(theirs)) => prop_assert!(theirs > 29.98, "parry hits at {theirs}, we miss"),
        }
    }

    #[test]
    fn capsule_contacts_are_as_deep_as_parry_says(
        corners in prop::array::uniform3((-1.5..1.5f32, -1.5..1.5f32, -1.5..1.5f32)),
        x in -1.0..1.0f32, y in -2.0..1.0f32, z in -1.0..1.0f32,
    ) {
        let corners = corners.map(|(x, y, z)| Vec3::new(x, y, z));
        let Some(triangle) = Triangle::new(corners, Surface::Ground) else { return Ok(()) };
        let (radius, height) = (0.3, 1.2);
        let low = Vec3::new(x, y, z);
        let high = low + Vec3::new(0.0, height, 0.0);
        let [a, b, c] = corners;
        let identity = parry3d::math::Pose::IDENTITY;
        let segment = parry3d::shape::Segment::new(low, high);
        let distance = query::distance(&identity, &ParryTriangle::new(a, b, c), &identity, &segment).unwrap().distance;
        match triangle.capsule_contact(low, height, radius) {
            // Deep contacts, where the axis passes through the triangle, are pushed out to the front instead.
            Some(contact) if distance > 1.0e-3 => {
                let expected = radius - distance;
                prop_assert!((contact.depth - expected).abs() < 1.0e-3, "{} against {expected}", contact.depth);
                prop_assert!((contact.normal.length() - 1.0).abs() < 1.0e-3);
            }
            Some(_) => {}
            None => {
                // Only contacts from behind may be ignored.
                let in_front = (low - a).dot(triangle.normal()) > 1.0e-3 && (high - a).dot(triangle.normal()) > 1.0e-3;
                prop_assert!(!in_front || distance > radius - 1.0e-3, "missed a contact at {distance} m");
            }
        }
    }
}

/// Distance and surface of every triangle that a ray meets, in 64-bit arithmetic; triangles are wider by `margin` of
/// their edges.
fn crossings(map: &Map, origin: Vec3, direction: Vec3, margin: f64) -> impl Iterator<Item = (f64, Surface)> {
    let wide = |v: Vec3| v.to_array().map(f64::from);
    let minus = |a: [f64; 3], b: [f64; 3]| [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
    let dot = |a: [f64; 3], b: [f64; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    let cross =
        |a: [f64; 3], b: [f64; 3]| [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
    let (origin, direction) = (wide(origin), wide(direction));
    map.mesh().triangles().iter().filter_map(move |triangle| {
        let [a, b, c] = triangle.corners().map(wide);
        let (ab, ac, offset) = (minus(b, a), minus(c, a), minus(origin, a));
        let (p, q) = (cross(direction, ac), cross(offset, ab));
        let inverse = 1.0 / dot(ab, p);
        let (u, v, distance) = (dot(offset, p) * inverse, dot(direction, q) * inverse, dot(ac, q) * inverse);
        let is_hit = u >= -margin && v >= -margin && u + v <= 1.0 + margin && distance >= 0.0;
        is_hit.then_some((distance, triangle.surface()))
    })
}

#[test]
fn a_million_rays_of_cones_end_where_parry_says() {
    const SLACK_M: f64 = 1.0e-3;
    const RANGE_M: f64 = 30.0;
    let (map, reference) = map();
    let (cone, profile) = (RayCone::default(), CharacterProfile::default());
    let mut rng = ChaCha8Rng::seed_from_u64(4);
    let (mut hit_count, mut difference_count) = (0, 0);
    for _ in 0..1_000_000 / RAY_COUNT {
        // Most eyes are as close to geometry as those of NPCs; some are inside rock, some beside the map.
        let near = map.mesh().triangles()[rng.random_range(0..map.mesh().triangles().len())].corners()[0];
        let offset = Vec3::new(rng.random_range(-3.0..3.0), rng.random_range(-1.0..4.0), rng.random_range(-3.0..3.0));
        let body = Body::at(near + offset, rng.random_range(-3.1..3.1));
        let mut hits = [None; RAY_COUNT];
        cone.cast(map, &profile, &body, |idx, distance, surface| hits[idx] = Some((f64::from(distance), surface)));
        let eye = RayCone::eye(&profile, &body);
        for (direction, ours) in cone.directions_of(&body).into_iter().zip(hits) {
            let theirs = reference.cast_local_ray(&Ray::new(eye, direction), RANGE_M as f32, false).map(f64::from);
            let agree = match (ours, theirs) {
                (Some((ours, _)), Some(theirs)) => (ours - theirs).abs() < SLACK_M,
                (ours, theirs) => ours.is_none() && theirs.is_none(),
            };
            hit_count += usize::from(ours.is_some());
            difference_count += usize::from(!agree);
            if agree && ours.is_none_or(|(_, surface)| surface == Surface::Ground) {
                continue;
            }
            // Where one of the two passes beside a triangle that the other hits, ours must hit some triangle, and none
            // before it.
            let distance = ours.map_or(RANGE_M, |(distance, _)| distance);
            let ray = format!("from {eye:?} to {direction:?}: {ours:?}, parry says {theirs:?}");
            if let Some((distance, surface)) = ours {
                let mut near = crossings(map, eye, direction, 2.0e-4);
                assert!(
                    near.any(|(at, of)| of == surface && (at - distance).abs() < SLACK_M),
                    "no such triangle {ray}"
                );
            }
            let nearest = crossings(map, eye, direction, -2.0e-4).map(|(at, _)| at).fold(f64::INFINITY, f64::min);
            assert!(nearest > distance - SLACK_M, "passes a triangle at {nearest} m {ray}");
        }
    }
    assert!(hit_count > 500_000, "only {hit_count} rays hit something");
    assert!(difference_count < 100, "{difference_count} rays differ from parry's");
    println!("{hit_count} hits, {difference_count} other than parry's");
}

#[test]
fn vertical_rays_at_lattice_points_do_not_slip_through() {
    let (map, _) = map();
    for i in 4..124 {
        for k in 4..124 {
            let origin = Vec3::new(i as f32 * 0.625, 79.5, k as f32 * 0.625);
            let hit = map.mesh().cast_ray(origin, Vec3::new(0.0, -1.0, 0.0), 80.0);
            assert!(hit.is_some(), "nothing under {origin:?}");
        }
    }
}

#[test]
fn the_uppermost_surface_faces_up() {
    let (map, _) = map();
    for i in 3..77 {
        for k in 3..77 {
            let origin = Vec3::new(i as f32 + 0.37, 79.5, k as f32 + 0.41);
            let direction = Vec3::new(0.001, -1.0, 0.002).normalize();
            let hit = map.mesh().cast_ray(origin, direction, 80.0).unwrap();
            let normal = map.mesh().triangles()[hit.triangle_idx as usize].normal();
            assert!(normal.dot(direction) < 0.0, "inside out at {origin:?}");
        }
    }
}

#[test]
fn sampled_ground_holds_the_body_clear_of_all_geometry() {
    let map = surefoot_generate::generate(&MapSpec::with_side(5, 120).unwrap());
    let profile = CharacterProfile::default();
    let points = navigable::sample_many(&map, &profile, 1500, &mut ChaCha8Rng::seed_from_u64(2)).unwrap();
    let slack = 0.02;
    let capsule = Capsule::new_y(profile.height / 2.0 - profile.radius, profile.radius - slack);
    let identity = parry3d::math::Pose::IDENTITY;
    for feet in points {
        let centre = feet + Vec3::new(0.0, profile.height / 2.0, 0.0);
        let pose = parry3d::math::Pose::from_translation(centre);
        let near = map.mesh().triangles().iter().filter(|triangle| {
            triangle.surface() == Surface::Ground
                && triangle.corners().iter().any(|corner| corner.distance(centre) < 12.0)
        });
        let mut supported = false;
        for triangle in near {
            let [a, b, c] = triangle.corners();
            let shape = ParryTriangle::new(a, b, c);
            assert!(
                !query::intersection_test(&pose, &capsule, &identity, &shape).unwrap().intersecting,
                "inside {triangle:?} at {feet:?}"
            );
            supported |= query::distance(&pose, &capsule, &identity, &shape).unwrap().distance < slack + 0.08;
        }
        assert!(supported, "floating at {feet:?}");
        assert!(map.liquid_at(feet, 0.0).is_none(), "in a pool at {feet:?}");
    }
}

/// Solid triangles of a whole map with all features as parry's mesh.
fn solid_map() -> &'static (Arc<Map>, TriMesh) {
    static MAP: OnceLock<(Arc<Map>, TriMesh)> = OnceLock::new();
    MAP.get_or_init(|| {
        let spec = MapSpec::with_side(8, 120).unwrap().with(|it| it.features = Features::all()).unwrap();
        let map = Arc::new(surefoot_generate::generate(&spec));
        let mesh = parry_mesh(&map);
        (map, mesh)
    })
}

/// The solid triangles of a map as parry's mesh.
fn parry_mesh(map: &Map) -> TriMesh {
    let solids = map.mesh().triangles().iter().filter(|triangle| triangle.surface().is_solid());
    let corners: Vec<Vec3> = solids.flat_map(Triangle::corners).collect();
    let indices = (0..corners.len() as u32 / 3).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
    TriMesh::new(corners, indices).unwrap()
}

/// A random triangle of the map's ground away from its rim.
fn some_triangle(map: &Map, rng: &mut ChaCha8Rng) -> Triangle {
    loop {
        let triangle = map.mesh().triangles()[rng.random_range(0..map.mesh().triangles().len())];
        let inner = triangle.corners().iter().all(|c| (3.0..117.0).contains(&c.x) && (3.0..117.0).contains(&c.z));
        if inner && triangle.surface().is_solid() {
            return triangle;
        }
    }
}

#[test]
fn rays_do_not_slip_through_corners_and_seams_of_a_map() {
    let (map, _) = solid_map();
    let mut rng = ChaCha8Rng::seed_from_u64(11);
    for round in 0..60_000 {
        let triangle = some_triangle(map, &mut rng);
        let corners = triangle.corners();
        // A corner, or a point of a side.
        let share = if round % 3 == 0 { 0.0 } else { rng.random_range(0.0..1.0) };
        let target = corners[0] + (corners[1] - corners[0]) * share;
        let aside = Vec3::new(rng.random_range(-1.0..1.0), rng.random_range(-1.0..1.0), rng.random_range(-1.0..1.0));
        // Steep enough that the seam is met and not grazed.
        let from = target + (triangle.normal() * 2.0 + aside).normalize() * rng.random_range(0.2..9.0);
        let way = target - from;
        let hit = map.mesh().cast_ray(from, way.normalize(), way.length() + 1.0);
        let distance = hit.map_or(f32::INFINITY, |hit| hit.distance);
        assert!(distance < way.length() + 0.02, "slipped through {target:?} from {from:?}: {distance}");
    }
}

#[test]
fn bodies_touch_a_map_exactly_where_parry_says() {
    let (map, reference) = solid_map();
    let profile = CharacterProfile::default();
    let mut rng = ChaCha8Rng::seed_from_u64(12);
    let mut scratch = MoveScratch::default();
    let (mut touching, mut free) = (0, 0);
    while touching < 3000 || free < 3000 {
        let triangle = some_triangle(map, &mut rng);
        let [a, b, c] = triangle.corners();
        // Corners and sides are as frequent as the inside.
        let (u, v) = [(0.0, 0.0), (0.5, 0.0), (0.3, 0.3)][rng.random_range(0..3)];
        let point = a + (b - a) * u + (c - a) * v + triangle.normal() * rng.random_range(0.05..0.5);
        let feet = point - Vec3::new(0.0, [profile.radius, 0.9, 1.5][rng.random_range(0..3)], 0.0);
        let low = feet + Vec3::new(0.0, profile.radius, 0.0);
        let high = feet + Vec3::new(0.0, profile.height - profile.radius, 0.0);
        let middle = (low + high) * 0.5;
        if [low, middle, high].iter().any(|&point| map.mesh().solid_depth_at(point) > 0) {
            continue;
        }
        let identity = parry3d::math::Pose::IDENTITY;
        let segment = parry3d::shape::Segment::new(low, high);
        let distance = query::distance(&identity, reference, &identity, &segment).unwrap().distance;
        let clear = is_clear(map.mesh(), &profile, feet, 0.005, &mut scratch);
        if distance < profile.radius - 0.01 && distance > 0.01 {
            touching += 1;
            assert!(!clear, "parry: {distance} m from the axis at {feet:?}, we call it clear");
        } else if distance > profile.radius + 0.001 {
            free += 1;
            assert!(clear, "parry: {distance} m from the axis at {feet:?}, we call it touching");
        }
    }
}

#[test]
fn running_bodies_rest_on_the_ground_that_parry_sees_and_enter_nothing() {
    let (map, reference) = solid_map();
    let profile = CharacterProfile::default();
    let mut rng = ChaCha8Rng::seed_from_u64(13);
    let points = navigable::sample_many(map, &profile, 48, &mut rng).unwrap();
    let mut world = World::new(map.clone(), profile.clone(), TaskConfig::default());
    let slots: Vec<NpcSlot> = points.iter().map(|&point| world.spawn(point, 0.3)).collect();
    let (mut grounded, mut deepest) = (0u32, 0.0f32);
    for tick in 0..1500 {
        for (idx, &slot) in slots.iter().enumerate() {
            if world.npc(slot).unwrap().harm.is_some() {
                world.teleport(slot, points[idx], 0.0);
            }
            if tick % 10 == 0 {
                let mut draw = |low: f32| rng.random_range(low..1.0);
                let action = [draw(-0.2), draw(-1.0), draw(-1.0), draw(-1.0) - 0.8];
                world.decide(slot, Action::from_array(action).unwrap());
            }
        }
        world.tick();
        for &slot in &slots {
            let npc = world.npc(slot).unwrap();
            if npc.harm.is_some() || npc.body.ride.is_some() {
                continue;
            }
            let low = npc.body.feet + Vec3::new(0.0, profile.radius, 0.0);
            let high = npc.body.feet + Vec3::new(0.0, profile.height - profile.radius, 0.0);
            let identity = parry3d::math::Pose::IDENTITY;
            let segment = parry3d::shape::Segment::new(low, high);
            let distance = query::distance(&identity, reference, &identity, &segment).unwrap().distance;
            deepest = deepest.max(profile.radius - distance);
            if npc.body.is_grounded() {
                grounded += 1;
                assert!(distance < profile.radius + 0.06, "grounded {distance} m from all ground at {low:?}");
            }
            assert!(distance > 0.05, "the axis is {distance} m from a face at {:?}, tick {tick}", npc.body.feet);
        }
    }
    assert!(grounded > 10_000, "{grounded}");
    assert!(deepest < 0.2, "pressed {deepest} m into the ground");
}

#[test]
fn of_a_million_spawns_none_is_off_the_ground_or_inside_geometry() {
    const SPAWNS: usize = 1_000_000;
    const MAPS: usize = 8;
    let next = AtomicUsize::new(0);
    std::thread::scope(|scope| {
        for _ in 0..2 {
            scope.spawn(|| {
                loop {
                    let idx = next.fetch_add(1, Ordering::Relaxed);
                    if idx >= MAPS {
                        return;
                    }
                    let features = if idx.is_multiple_of(2) { Features::all() } else { Features::default() };
                    let map = surefoot_generate::generate(
                        &MapSpec::with_side(40 + idx as u64, 150).unwrap().with(|it| it.features = features).unwrap(),
                    );
                    check_spawns(&map, SPAWNS / MAPS, idx as u64);
                }
            });
        }
    });
}

/// Whether a point lies in a solid: all three of parry's rays to the sky leave through more faces than they enter. One
/// or two rays may be wrong where faces coincide or a seam leaks.
fn is_inside(mesh: &TriMesh, point: Vec3) -> bool {
    // Away from the rim, where the ground is cut off and has no underside.
    let inwards = (Vec3::new(75.0, 0.0, 75.0) - Vec3::new(point.x, 0.0, point.z)).normalize_or_zero();
    [0.01, 0.06, 0.17].iter().all(|tilt| {
        let direction = (Vec3::Y + inwards * *tilt + Vec3::new(0.003, 0.0, -0.002)).normalize();
        let (mut origin, mut left) = (point, 0);
        while let Some(hit) = mesh.cast_local_ray_and_get_normal(&Ray::new(origin, direction), 500.0, false) {
            // Of a triangle's two faces, 0 is its front.
            left += if hit.feature == FeatureId::Face(0) { -1 } else { 1 };
            origin += direction * (hit.time_of_impact + 1.0e-3);
        }
        left > 0
    })
}

fn check_spawns(map: &Map, count: usize, seed: u64) {
    let profile = CharacterProfile::default();
    let mut scratch = MoveScratch::default();
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let reference = parry_mesh(map);
    for _ in 0..count {
        let feet = navigable::sample(map, &profile, &mut rng, &mut scratch).unwrap();
        let lower = feet - Vec3::new(0.0, 0.03, 0.0);
        assert!(!is_clear(map.mesh(), &profile, lower, 0.011, &mut scratch), "nothing under {feet:?}");
        assert!(is_clear(map.mesh(), &profile, feet, 0.011, &mut scratch), "pressed into geometry at {feet:?}");
        let chest = feet + Vec3::new(0.0, 0.9, 0.0);
        assert!(!is_inside(&reference, chest), "inside a solid at {feet:?}, map {:?}", map.spec());
        assert!(map.liquid_at(feet, 0.0).is_none() && map.device_at(feet).is_none(), "{feet:?}");
    }
}
