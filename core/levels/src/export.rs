//! Exports a map as binary glTF 2.0, for modelling tools and game engines; the importer reads it back.
//!
//! The scene has one mesh node `ground`, one node for each pool and device with the names that `named` knows, and empty
//! nodes that mark buildings, plateaus, ravines and caves. Its extras keep the map's size.

use crate::file::numbered;
use crate::found::{PAD_EXTRA_M, PAD_GRAVITY};
use serde_json::{Value, json};
use std::collections::HashMap;
use std::f32::consts::TAU;
use surefoot_world::map::spot::{ANCHOR, SPAWN};
use surefoot_world::map::{DISC_RADIUS_M, DeviceKind, Map, MapSize, MoverKind, Outline};
use surefoot_world::mesh::{Surface, Triangle};
use surefoot_world::{Aabb, Vec3};

/// Number of corners of a device's disc.
const DISC_SIDES: usize = 16;
/// Height of a device's disc, m.
const DISC_HEIGHT_M: f32 = 0.12;

/// Numbers of glTF 2.0: types of components, targets of views.
const FLOAT: u32 = 5126;
const UNSIGNED_INT: u32 = 5125;
const ARRAY_BUFFER: u32 = 34962;
const ELEMENT_ARRAY_BUFFER: u32 = 34963;

/// Encodes the map as a `.glb` file.
pub fn export_glb(map: &Map) -> Vec<u8> {
    let mut scene = SceneWriter::default();
    for (name, surface) in [("ground", Surface::Ground), ("climb", Surface::Climb)] {
        let solids = map.mesh().triangles().iter().filter(|triangle| triangle.surface() == surface);
        if let Some(mesh) = scene.add_mesh(name, surface, solids.map(Triangle::corners)) {
            scene.nodes.push(json!({ "name": name, "mesh": mesh }));
        }
    }
    add_pools(&mut scene, map);
    add_devices(&mut scene, map);
    add_spots(&mut scene, map);
    add_movers(&mut scene, map);
    add_landmarks(&mut scene, map);
    scene.finish(map.size())
}

/// Adds each pool as a box from its surface to its depth.
fn add_pools(scene: &mut SceneWriter, map: &Map) {
    let mut counts = [0; Surface::ALL.len()];
    for pool in &map.placed().pools {
        let surface = Surface::from(pool.liquid);
        let name = format!("{}_{}", surface.name(), counts[surface as usize]);
        counts[surface as usize] += 1;
        let mesh = scene.shared_mesh(surface, box_below_origin);
        let (half_x, half_z) = pool.outline.half_extents();
        let extras = match pool.outline {
            Outline::Round { radius } => json!({ "outline": "round", "radius": radius }),
            Outline::Rectangle { .. } => Value::Null,
        };
        let mut node = node(&name, pool.centre, Some(mesh), extras);
        node["scale"] = json!([2.0 * half_x, pool.depth, 2.0 * half_z]);
        scene.nodes.push(node);
    }
}

fn add_devices(scene: &mut SceneWriter, map: &Map) {
    for device in map.placed().devices() {
        let (name, power) = (format!("{}_{}", device.kind.name(), device.idx), f64::from(device.power));
        let extras = match device.kind {
            DeviceKind::Pad => json!({ "height": power * power / (2.0 * PAD_GRAVITY) - PAD_EXTRA_M }),
            DeviceKind::ZipLine => Value::Null,
            DeviceKind::Teleporter => json!({ "two_way": device.two_way }),
            DeviceKind::Jetpack => json!({ "fuel": power }),
        };
        let end = if device.to.is_some() { ":from" } else { "" };
        scene.add_disc(&format!("{name}{end}"), device.kind, device.from, extras);
        match device.to {
            Some(to) if device.two_way => scene.add_disc(&format!("{name}:to"), device.kind, to, Value::Null),
            Some(to) => scene.add_empty(&format!("{name}:to"), to, Value::Null),
            None => {}
        }
    }
}

fn add_spots(scene: &mut SceneWriter, map: &Map) {
    for (idx, spot) in map.placed().spots.iter().enumerate() {
        let is_word = [ANCHOR, SPAWN].contains(&spot.tag.as_str());
        let name = if is_word { format!("{}_{idx}", spot.tag) } else { format!("move_{}_{idx}", spot.tag) };
        let extras = if spot.two_way { json!({ "two_way": true }) } else { Value::Null };
        let end = if spot.to.is_some() { ":from" } else { "" };
        scene.add_empty(&format!("{name}{end}"), spot.from, extras);
        spot.to.into_iter().for_each(|to| scene.add_empty(&format!("{name}:to"), to, Value::Null));
    }
}

/// Adds each mover as a node at its pivot, with extras that make the same mover of it.
fn add_movers(scene: &mut SceneWriter, map: &Map) {
    for mover in map.movers() {
        let around = mover.triangles.iter().map(|corners| corners.map(|corner| corner - mover.pivot));
        let Some(mesh) = scene.add_mesh(&mover.name, Surface::Ground, around) else { continue };
        let further = &mover.stops[1..];
        let mut extras = json!({
            "mover": mover.kind.name(),
            "seconds": mover.travel_s,
            "dwell": mover.dwell_s,
            "loop": mover.cycles,
            "open": mover.start.0 > 0,
            "velocity": mover.belt.to_array(),
        });
        if let Some(turned) = further.first().filter(|stop| stop.yaw != 0.0) {
            extras["hinge"] = json!(turned.yaw.to_degrees());
        } else if mover.kind != MoverKind::Floor {
            extras["path"] = further.iter().map(|stop| json!(stop.offset.to_array())).collect();
        }
        scene.nodes.push(node(&mover.name, mover.pivot, Some(mesh), extras));
    }
}

/// Adds what is part of the ground, as nodes without a mesh.
fn add_landmarks(scene: &mut SceneWriter, map: &Map) {
    let placed = map.placed();
    for (idx, building) in placed.buildings.iter().enumerate() {
        let extras = json!({
            "half": building.half,
            "yaw": building.yaw,
            "height": building.height,
            "storeys": building.storeys,
            "roof_stairs": building.roof_stairs,
        });
        scene.add_empty(&format!("building_{idx}"), building.base, extras);
    }
    for (idx, plateau) in placed.plateaus.iter().enumerate() {
        scene.add_empty(&format!("plateau_{idx}"), plateau.top, json!({ "radius": plateau.radius }));
    }
    for (idx, ravine) in placed.ravines.iter().enumerate() {
        let path: Vec<[f32; 3]> = ravine.path.iter().map(|point| point.to_array()).collect();
        let start = ravine.path.first().copied().unwrap_or_default();
        scene.add_empty(&format!("ravine_{idx}"), start, json!({ "path": path, "width": ravine.width }));
    }
    for (idx, cave) in placed.caves.iter().enumerate() {
        scene.add_empty(&format!("cave_{idx}"), cave.from, json!({ "to": cave.to.to_array(), "radius": cave.radius }));
    }
}

/// A box of 1 m whose top is centred on the origin.
fn box_below_origin() -> Vec<[Vec3; 3]> {
    let rim = [(-0.5, -0.5), (-0.5, 0.5), (0.5, 0.5), (0.5, -0.5)];
    prism(&rim.map(|(x, z)| Vec3::new(x, 0.0, z)), -1.0, 0.0)
}

/// A device's disc, with the centre of its bottom at the origin.
fn disc() -> Vec<[Vec3; 3]> {
    let rim: Vec<Vec3> = (0..DISC_SIDES)
        .map(|i| {
            let (sin, cos) = libm::sincosf(i as f32 * TAU / DISC_SIDES as f32);
            Vec3::new(sin, 0.0, cos) * DISC_RADIUS_M
        })
        .collect();
    prism(&rim, 0.0, DISC_HEIGHT_M)
}

/// A closed upright prism over a rim that runs counter-clockwise seen from above.
fn prism(rim: &[Vec3], bottom: f32, top: f32) -> Vec<[Vec3; 3]> {
    let at = |i: usize, y: f32| rim[i % rim.len()].with_y(y);
    let mut triangles = Vec::new();
    for i in 1..rim.len() - 1 {
        triangles.push([at(0, top), at(i, top), at(i + 1, top)]);
        triangles.push([at(0, bottom), at(i + 1, bottom), at(i, bottom)]);
    }
    for i in 0..rim.len() {
        triangles.push([at(i, bottom), at(i + 1, bottom), at(i + 1, top)]);
        triangles.push([at(i, bottom), at(i + 1, top), at(i, top)]);
    }
    triangles
}

/// A node at a place, with these extras unless they are null. Numbers of 32 bits are widened in a [`Value`], so they
/// print with all digits and read back with the same bits.
fn node(name: &str, at: Vec3, mesh: Option<usize>, extras: Value) -> Value {
    let mut node = json!({ "name": name, "translation": at.to_array() });
    let further = [("mesh", json!(mesh)), ("extras", extras)];
    further.into_iter().filter(|(_, value)| !value.is_null()).for_each(|(key, value)| node[key] = value);
    node
}

/// Collects a glTF document and its binary data.
#[derive(Default)]
struct SceneWriter {
    nodes: Vec<Value>,
    meshes: Vec<Value>,
    accessors: Vec<Value>,
    views: Vec<Value>,
    binary: Vec<u8>,
    shared: HashMap<&'static str, usize>,
}

impl SceneWriter {
    /// Adds an indexed mesh, with corners welded where their bits are equal; `None` if there are no triangles.
    fn add_mesh(&mut self, name: &str, surface: Surface, triangles: impl Iterator<Item = [Vec3; 3]>) -> Option<usize> {
        let (vertices, corners) = numbered(triangles.flatten());
        let Aabb { low, high } = Aabb::around(vertices.iter().copied())?;
        let positions: Vec<u8> = vertices.iter().flat_map(Vec3::to_array).flat_map(f32::to_le_bytes).collect();
        let indices: Vec<u8> = corners.iter().copied().flat_map(u32::to_le_bytes).collect();
        let positions = json!({
            "bufferView": self.add_view(&positions, ARRAY_BUFFER),
            "componentType": FLOAT,
            "type": "VEC3",
            "count": vertices.len(),
            "min": low.to_array(),
            "max": high.to_array(),
        });
        let indices = json!({
            "bufferView": self.add_view(&indices, ELEMENT_ARRAY_BUFFER),
            "componentType": UNSIGNED_INT,
            "type": "SCALAR",
            "count": corners.len(),
        });
        let primitive = json!({
            "attributes": { "POSITION": push(&mut self.accessors, positions) },
            "indices": push(&mut self.accessors, indices),
            "material": surface as u32,
        });
        Some(push(&mut self.meshes, json!({ "name": name, "primitives": [primitive] })))
    }

    /// Returns a mesh that several nodes share, and adds it when it is first needed.
    fn shared_mesh(&mut self, surface: Surface, make: impl Fn() -> Vec<[Vec3; 3]>) -> usize {
        let name = surface.name();
        if let Some(&mesh) = self.shared.get(name) {
            return mesh;
        }
        let mesh = self.add_mesh(name, surface, make().into_iter()).expect("shared meshes have triangles");
        self.shared.insert(name, mesh);
        mesh
    }

    /// Adds a buffer view of positions or indices. All values are four bytes wide, so every view begins at a multiple
    /// of four.
    fn add_view(&mut self, bytes: &[u8], target: u32) -> usize {
        let offset = self.binary.len();
        self.binary.extend(bytes);
        let view = json!({ "buffer": 0, "byteOffset": offset, "byteLength": bytes.len(), "target": target });
        push(&mut self.views, view)
    }

    fn add_disc(&mut self, name: &str, kind: DeviceKind, centre: Vec3, extras: Value) {
        let mesh = self.shared_mesh(kind.surface(), disc);
        self.nodes.push(node(name, centre, Some(mesh), extras));
    }

    fn add_empty(&mut self, name: &str, at: Vec3, extras: Value) {
        self.nodes.push(node(name, at, None, extras));
    }

    fn finish(self, MapSize { width, height, depth }: MapSize) -> Vec<u8> {
        let materials: Vec<Value> = Surface::ALL.iter().copied().map(material).collect();
        let scene = json!({
            "name": "map",
            "nodes": (0..self.nodes.len()).collect::<Vec<_>>(),
            "extras": { "surefoot": { "size": [width, height, depth] } },
        });
        let mut root = json!({
            "asset": { "version": "2.0", "generator": "Surefoot" },
            "scene": 0,
            "scenes": [scene],
            "materials": materials,
        });
        // glTF does not allow empty arrays and buffers.
        let buffers = if self.binary.is_empty() { vec![] } else { vec![json!({ "byteLength": self.binary.len() })] };
        let lists = [
            ("nodes", self.nodes),
            ("meshes", self.meshes),
            ("accessors", self.accessors),
            ("bufferViews", self.views),
            ("buffers", buffers),
        ];
        lists.into_iter().filter(|(_, list)| !list.is_empty()).for_each(|(name, list)| root[name] = list.into());
        if root.get("nodes").is_none() {
            root["scenes"][0].as_object_mut().expect("an object").remove("nodes");
        }
        binary_gltf(root.to_string().into_bytes(), &self.binary)
    }
}

/// Adds a value and returns its index.
fn push(list: &mut Vec<Value>, value: Value) -> usize {
    list.push(value);
    list.len() - 1
}

/// The container of a binary glTF (glTF 2.0, section 4.4), whose chunks are padded to multiples of four bytes.
fn binary_gltf(mut json: Vec<u8>, binary: &[u8]) -> Vec<u8> {
    json.resize(json.len().next_multiple_of(4), b' ');
    let chunks: &[(&[u8; 4], &[u8])] = &[(b"JSON", &json), (b"BIN\0", binary)];
    let chunks = &chunks[..if binary.is_empty() { 1 } else { 2 }];
    let len = 12 + chunks.iter().map(|(_, content)| 8 + content.len()).sum::<usize>();
    let mut bytes = Vec::with_capacity(len);
    bytes.extend(b"glTF");
    bytes.extend(2_u32.to_le_bytes());
    bytes.extend((len as u32).to_le_bytes());
    for (kind, content) in chunks {
        bytes.extend((content.len() as u32).to_le_bytes());
        bytes.extend(*kind);
        bytes.extend(*content);
    }
    bytes
}

fn material(surface: Surface) -> Value {
    let (colour, glow) = match surface {
        Surface::Ground => ([0.36, 0.33, 0.27, 1.0], [0.0, 0.0, 0.0]),
        Surface::Climb => ([0.45, 0.33, 0.16, 1.0], [0.0, 0.0, 0.0]),
        Surface::Water => ([0.08, 0.30, 0.55, 0.6], [0.0, 0.0, 0.0]),
        Surface::Lava => ([0.90, 0.20, 0.03, 1.0], [0.8, 0.15, 0.0]),
        Surface::Pad => ([0.95, 0.75, 0.10, 1.0], [0.0, 0.0, 0.0]),
        Surface::ZipLine => ([0.15, 0.70, 0.35, 1.0], [0.0, 0.0, 0.0]),
        Surface::Teleporter => ([0.55, 0.20, 0.80, 1.0], [0.1, 0.0, 0.2]),
        Surface::Jetpack => ([0.85, 0.85, 0.90, 1.0], [0.0, 0.0, 0.0]),
    };
    json!({
        "name": surface.name(),
        "alphaMode": if surface == Surface::Water { "BLEND" } else { "OPAQUE" },
        "pbrMetallicRoughness": { "baseColorFactor": colour, "metallicFactor": 0.0, "roughnessFactor": 0.9 },
        "emissiveFactor": glow,
    })
}
