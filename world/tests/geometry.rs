//! The fast paths against parry's own answers.

use parry3d::query::{self, Ray, RayCast};
use parry3d::shape::{Capsule, TriMesh, Triangle as ParryTriangle};
use proptest::prelude::*;
use rand::SeedableRng;
use rand::rngs::ChaCha8Rng;
use std::sync::OnceLock;
use surefoot_world::mesh::{Surface, Triangle};
use surefoot_world::{CharacterProfile, Map, MapSpec, Vec3, navigable};

fn map() -> &'static (Map, TriMesh) {
    static MAP: OnceLock<(Map, TriMesh)> = OnceLock::new();
    MAP.get_or_init(|| {
        let map = Map::generate(&MapSpec::with_side(21, 80)).unwrap();
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
    #![proptest_config(ProptestConfig { cases: 3000, rng_seed: proptest::test_runner::RngSeed::Fixed(1), failure_persistence: None, ..ProptestConfig::default() })]

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
            // may pass on either side of it; a hit of ours must still lie on a triangle.
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
                prop_assert!((contact.depth - (radius - distance)).abs() < 1.0e-3, "{} against {}", contact.depth, radius - distance);
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
    let map = Map::generate(&MapSpec::with_side(5, 120)).unwrap();
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
