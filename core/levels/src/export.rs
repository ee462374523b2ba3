//! Exports a map as binary glTF 2.0, for modelling tools and game engines; the importer reads it back.
//!
//! The scene has one mesh node `ground`, one node for each pool and device with the names that `named` knows, and empty
//! nodes that mark buildings, plateaus, ravines and caves. Its extras keep the map's size.

use crate::named::{PAD_EXTRA_M, PAD_GRAVITY};
use serde_json::{Value, json};
use std::collections::HashMap;
use std::f32::consts::TAU;
use surefoot_world::Vec3;
use surefoot_world::map::{DISC_RADIUS_M, DeviceKind, Map, MapSize, MoverKind, Outline};
use surefoot_world::mesh::{Surface, Triangle};

/// Number of corners of a device's disc.
const DISC_SIDES: usize = 16;
/// Height of a device's disc, m.
const DISC_HEIGHT_M: f32 = 0.12;
/// Component types and buffer targets of glTF.
const UNSIGNED_INT: u32 = 5125;
const FLOAT: u32 = 5126;
const ARRAY_BUFFER: u32 = 34962;
const ELEMENT_ARRAY_BUFFER: u32 = 34963;

/// Encodes the map as a `.glb` file.
pub fn export_glb(map: &Map) -> Vec<u8> {
    let mut scene = SceneWriter::default();
    let solids = map.mesh().triangles().iter().filter(|triangle| triangle.surface().is_solid());
    if let Some(ground) = scene.add_mesh("ground", Surface::Ground, solids.map(Triangle::corners)) {
        scene.nodes.push(json!({ "name": "ground", "mesh": ground }));
    }
    add_pools(&mut scene, map);
    add_devices(&mut scene, map);
    add_movers(&mut scene, map);
    add_landmarks(&mut scene, map);
    scene.finish(map.size())
}

/// Adds each pool as a box from its surface to its depth.
fn add_pools(scene: &mut SceneWriter, map: &Map) {
    let mut counts = [0, 0];
    for pool in &map.placed().pools {
        let surface = Surface::from(pool.liquid);
        let (name, count) = (surface.name(), &mut counts[pool.liquid as usize]);
        let mesh = scene.shared_mesh(surface, box_below_origin);
        let (half_x, half_z) = pool.outline.half_extents();
        let mut node = json!({
            "name": format!("{name}_{count}"),
            "mesh": mesh,
            "translation": numbers(pool.centre),
            "scale": numbers(Vec3::new(2.0 * half_x, pool.depth, 2.0 * half_z)),
        });
        if let Outline::Round { radius } = pool.outline {
            node["extras"] = json!({ "outline": "round", "radius": f64::from(radius) });
        }
        *count += 1;
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
        scene.add_disc(format!("{name}{end}"), device.kind, device.from, extras);
        match device.to {
            Some(to) if device.two_way => scene.add_disc(format!("{name}:to"), device.kind, to, Value::Null),
            Some(to) => scene.add_empty(format!("{name}:to"), to, Value::Null),
            None => {}
        }
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
            "seconds": f64::from(mover.travel_s),
            "dwell": f64::from(mover.dwell_s),
            "loop": mover.cycles,
            "open": mover.start.0 > 0,
            "velocity": numbers(mover.belt),
        });
        if let Some(turned) = further.first().filter(|stop| stop.yaw != 0.0) {
            extras["hinge"] = json!(f64::from(turned.yaw.to_degrees()));
        } else if mover.kind != MoverKind::Floor {
            extras["path"] = further.iter().map(|stop| numbers(stop.offset)).collect();
        }
        scene.add_empty(mover.name.clone(), mover.pivot, extras);
        if let Some(node) = scene.nodes.last_mut() {
            node["mesh"] = json!(mesh);
        }
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
        scene.add_empty(format!("building_{idx}"), building.base, extras);
    }
    for (idx, plateau) in placed.plateaus.iter().enumerate() {
        scene.add_empty(format!("plateau_{idx}"), plateau.top, json!({ "radius": plateau.radius }));
    }
    for (idx, ravine) in placed.ravines.iter().enumerate() {
        let path: Vec<Value> = ravine.path.iter().map(|&point| numbers(point)).collect();
        let start = ravine.path.first().copied().unwrap_or_default();
        scene.add_empty(format!("ravine_{idx}"), start, json!({ "path": path, "width": ravine.width }));
    }
    for (idx, cave) in placed.caves.iter().enumerate() {
        scene.add_empty(format!("cave_{idx}"), cave.from, json!({ "to": numbers(cave.to), "radius": cave.radius }));
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

/// Coordinates as JSON numbers, widened to `f64` so that they print with all digits and read back with the same bits.
fn numbers(point: Vec3) -> Value {
    json!(point.to_array().map(f64::from))
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
        let mut numbers: HashMap<[u32; 3], u32> = HashMap::new();
        let (mut positions, mut indices) = (Vec::new(), Vec::new());
        let (mut low, mut high) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
        for corner in triangles.flatten() {
            let next = numbers.len() as u32;
            let number = *numbers.entry(corner.to_array().map(f32::to_bits)).or_insert_with(|| {
                positions.extend(corner.to_array().into_iter().flat_map(f32::to_le_bytes));
                (low, high) = (low.min(corner), high.max(corner));
                next
            });
            indices.extend(number.to_le_bytes());
        }
        let index_count = indices.len() / 4;
        if index_count == 0 {
            return None;
        }
        let position = json!({
            "bufferView": self.add_view(&positions, ARRAY_BUFFER),
            "componentType": FLOAT,
            "count": numbers.len(),
            "type": "VEC3",
            "min": self::numbers(low),
            "max": self::numbers(high),
        });
        let index = json!({
            "bufferView": self.add_view(&indices, ELEMENT_ARRAY_BUFFER),
            "componentType": UNSIGNED_INT,
            "count": index_count,
            "type": "SCALAR",
        });
        let first = self.accessors.len();
        self.accessors.extend([position, index]);
        self.meshes.push(json!({
            "name": name,
            "primitives": [{
                "attributes": { "POSITION": first },
                "indices": first + 1,
                "material": surface as usize,
            }],
        }));
        Some(self.meshes.len() - 1)
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

    /// Adds a buffer view. All values are four bytes wide, so every view begins at a multiple of four.
    fn add_view(&mut self, bytes: &[u8], target: u32) -> usize {
        self.views.push(json!({
            "buffer": 0,
            "byteOffset": self.binary.len(),
            "byteLength": bytes.len(),
            "target": target,
        }));
        self.binary.extend(bytes);
        self.views.len() - 1
    }

    fn add_disc(&mut self, name: String, kind: DeviceKind, centre: Vec3, extras: Value) {
        let mesh = self.shared_mesh(kind.surface(), disc);
        self.add_empty(name, centre, extras);
        if let Some(node) = self.nodes.last_mut() {
            node["mesh"] = json!(mesh);
        }
    }

    fn add_empty(&mut self, name: String, at: Vec3, extras: Value) {
        let mut node = json!({ "name": name, "translation": numbers(at) });
        if !extras.is_null() {
            node["extras"] = extras;
        }
        self.nodes.push(node);
    }

    /// Writes the header, the JSON chunk padded with spaces, and the binary chunk padded with zeros (glTF 2.0, section
    /// 4.4).
    fn finish(self, MapSize { width, height, depth }: MapSize) -> Vec<u8> {
        let mut document = json!({
            "asset": { "version": "2.0", "generator": "Surefoot" },
            "scene": 0,
            "scenes": [{ "name": "map", "extras": { "surefoot": { "size": [width, height, depth] } } }],
            "materials": Surface::ALL.iter().copied().map(material).collect::<Vec<_>>(),
        });
        let lists = [
            ("nodes", self.nodes),
            ("meshes", self.meshes),
            ("accessors", self.accessors),
            ("bufferViews", self.views),
        ];
        // glTF does not allow empty lists.
        for (name, list) in lists.into_iter().filter(|(_, list)| !list.is_empty()) {
            if name == "nodes" {
                document["scenes"][0]["nodes"] = json!((0..list.len()).collect::<Vec<_>>());
            }
            document[name] = Value::Array(list);
        }
        let mut binary = self.binary;
        if !binary.is_empty() {
            document["buffers"] = json!([{ "byteLength": binary.len() }]);
        }
        let mut json = document.to_string().into_bytes();
        json.resize(json.len().next_multiple_of(4), b' ');
        binary.resize(binary.len().next_multiple_of(4), 0);

        let chunks: [(&[u8; 4], Vec<u8>); 2] = [(b"JSON", json), (b"BIN\0", binary)];
        let mut bytes = Vec::new();
        bytes.extend(b"glTF");
        bytes.extend(2u32.to_le_bytes());
        let len: usize = chunks.iter().filter(|(_, chunk)| !chunk.is_empty()).map(|(_, chunk)| 8 + chunk.len()).sum();
        bytes.extend((12 + len as u32).to_le_bytes());
        for (kind, chunk) in chunks.into_iter().filter(|(_, chunk)| !chunk.is_empty()) {
            bytes.extend((chunk.len() as u32).to_le_bytes());
            bytes.extend(kind);
            bytes.extend(chunk);
        }
        bytes
    }
}

fn material(surface: Surface) -> Value {
    let (colour, glow) = match surface {
        Surface::Ground => ([0.36, 0.33, 0.27, 1.0], [0.0, 0.0, 0.0]),
        Surface::Water => ([0.08, 0.30, 0.55, 0.6], [0.0, 0.0, 0.0]),
        Surface::Lava => ([0.90, 0.20, 0.03, 1.0], [0.8, 0.15, 0.0]),
        Surface::Pad => ([0.95, 0.75, 0.10, 1.0], [0.0, 0.0, 0.0]),
        Surface::ZipLine => ([0.15, 0.70, 0.35, 1.0], [0.0, 0.0, 0.0]),
        Surface::Teleporter => ([0.55, 0.20, 0.80, 1.0], [0.1, 0.0, 0.2]),
        Surface::Jetpack => ([0.85, 0.85, 0.90, 1.0], [0.0, 0.0, 0.0]),
    };
    let mut material = json!({
        "name": surface.name(),
        "pbrMetallicRoughness": { "baseColorFactor": colour, "metallicFactor": 0.0, "roughnessFactor": 0.9 },
        "emissiveFactor": glow,
    });
    if surface == Surface::Water {
        material["alphaMode"] = json!("BLEND");
    }
    material
}
