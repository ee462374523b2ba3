//! Compressed glTF files, whole and damaged. All of `fixtures` hold the same terrain.

use crate::{PLAIN, obj};
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use std::collections::BTreeMap;
use surefoot_levels::NoFiles;
use surefoot_world::Map;

/// Squares of 2 m along each side of the terrain.
const SIDE: u32 = 23;
/// Largest error of a place, m: that of Draco's 14 bits.
const TOLERANCE_M: f32 = 0.005;

const LEVELS: [(&str, &[u8]); 6] = [
    ("meshopt_0", include_bytes!("../fixtures/meshopt_0.glb")),
    ("meshopt_1", include_bytes!("../fixtures/meshopt_1.glb")),
    ("meshopt_filtered", include_bytes!("../fixtures/meshopt_filtered.glb")),
    ("draco_edge_breaker", include_bytes!("../fixtures/draco_edge_breaker.glb")),
    ("draco_quantized", include_bytes!("../fixtures/draco_quantized.glb")),
    ("draco_sequential", include_bytes!("../fixtures/draco_sequential.glb")),
];

/// The terrain as a plain file.
fn terrain() -> Map {
    let vertices = (0..=SIDE).flat_map(|z| (0..=SIDE).map(move |x| (x, z)));
    let vertices = vertices.map(|(x, z)| format!("v {} {} {}\n", 2 * x, f64::from((x * 7 + z * 5) % 4) * 0.1, 2 * z));
    let squares = (0..SIDE).flat_map(|z| (0..SIDE).map(move |x| 1 + z * (SIDE + 1) + x));
    let faces = squares.map(|at| {
        let (next, right, across) = (at + SIDE + 1, at + 1, at + SIDE + 2);
        format!("f {at} {next} {right}\nf {right} {next} {across}\n")
    });
    obj(&vertices.chain(faces).collect::<String>()).map
}

/// The heights of the corners of each triangle, by their places on the terrain's grid.
fn heights(map: &Map) -> BTreeMap<[[i32; 2]; 3], [f32; 3]> {
    let on_grid = |at: f32| {
        let place = (at / 2.0).round();
        assert!((at - 2.0 * place).abs() < TOLERANCE_M, "{at} is not on the grid");
        place as i32
    };
    let triangles = map.mesh().triangles().iter().map(|triangle| {
        let mut corners = triangle.corners().map(|at| ([on_grid(at.x), on_grid(at.z)], at.y));
        corners.sort_by_key(|(place, _)| *place);
        (corners.map(|(place, _)| place), corners.map(|(_, height)| height))
    });
    triangles.collect()
}

#[test]
fn compressed_levels_are_those_that_were_compressed() {
    let plain = terrain();
    let expected = heights(&plain);
    assert_eq!(expected.len() as u32, 2 * SIDE * SIDE);
    for (name, level) in LEVELS {
        let imported = surefoot_levels::import_gltf(level, None, &PLAIN, &NoFiles);
        let map = imported.unwrap_or_else(|error| panic!("{name}: {error}")).map;
        assert_eq!(map.mesh().triangles().len(), plain.mesh().triangles().len(), "{name}");
        let found = heights(&map);
        assert!(found.keys().eq(expected.keys()), "{name} has other triangles");
        for (one, other) in found.values().flatten().zip(expected.values().flatten()) {
            assert!((one - other).abs() < TOLERANCE_M, "{name}: {one} is not {other}");
        }
    }
}

#[test]
fn damaged_compressed_levels_are_refused_or_read_and_never_worse() {
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let mut refused = 0;
    for (name, level) in LEVELS {
        let binary = level.windows(4).position(|window| window == b"BIN\0").expect("a binary chunk") + 4;
        for _ in 0..100 {
            let mut damaged = level.to_vec();
            for _ in 0..rng.random_range(1..6) {
                let at = rng.random_range(binary..damaged.len());
                damaged[at] = rng.random_range(0..=255);
            }
            let imported = surefoot_levels::import_gltf(&damaged, None, &PLAIN, &NoFiles);
            refused += usize::from(imported.is_err_and(|error| !error.to_string().is_empty()));
        }
        assert!(refused > 0, "{name}");
    }
    assert!(refused > 60, "{refused} of 600");
}
