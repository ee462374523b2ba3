//! Exports a map as binary glTF 2.0, for modelling tools and game engines; the importer reads it back.
//!
//! The scene has one mesh node `ground`, one node for each pool and device with the names that `named` knows, and empty
//! nodes that mark buildings, plateaus, ravines and caves. Its extras keep the map's size.

use crate::file::numbered;
use crate::found::{PAD_EXTRA_M, PAD_GRAVITY};
use gltf::Glb;
use gltf::binary::Header;
use gltf::json::accessor::{Accessor, ComponentType, GenericComponentType, Type};
use gltf::json::buffer::{Buffer, Target, View};
use gltf::json::material::{
    AlphaMode, EmissiveFactor, Material, PbrBaseColorFactor, PbrMetallicRoughness, StrengthFactor,
};
use gltf::json::mesh::{Mesh, Mode, Primitive, Semantic};
use gltf::json::validation::Checked::Valid;
use gltf::json::{Extras, Index, Node, Root, Scene};
use serde_json::value::to_raw_value;
use serde_json::{Value, json};
use std::collections::{BTreeMap, HashMap};
use std::f32::consts::TAU;
use surefoot_world::map::{DISC_RADIUS_M, DeviceKind, Map, MapSize, MoverKind, Outline};
use surefoot_world::mesh::{Surface, Triangle};
use surefoot_world::{Aabb, Vec3};

/// Number of corners of a device's disc.
const DISC_SIDES: usize = 16;
/// Height of a device's disc, m.
const DISC_HEIGHT_M: f32 = 0.12;

/// Encodes the map as a `.glb` file.
pub fn export_glb(map: &Map) -> Vec<u8> {
    let mut scene = SceneWriter::default();
    let solids = map.mesh().triangles().iter().filter(|triangle| triangle.surface().is_solid());
    if let Some(ground) = scene.add_mesh("ground", Surface::Ground, solids.map(Triangle::corners)) {
        scene.root.push(Node { name: Some("ground".to_owned()), mesh: Some(ground), ..Node::default() });
    }
    add_pools(&mut scene, map);
    add_devices(&mut scene, map);
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
        let scale = Some([2.0 * half_x, pool.depth, 2.0 * half_z]);
        scene.root.push(Node { scale, ..node(name, pool.centre, Some(mesh), extras) });
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
        scene.root.push(node(mover.name.clone(), mover.pivot, Some(mesh), extras));
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
        let path: Vec<[f32; 3]> = ravine.path.iter().map(|point| point.to_array()).collect();
        let start = ravine.path.first().copied().unwrap_or_default();
        scene.add_empty(format!("ravine_{idx}"), start, json!({ "path": path, "width": ravine.width }));
    }
    for (idx, cave) in placed.caves.iter().enumerate() {
        scene.add_empty(format!("cave_{idx}"), cave.from, json!({ "to": cave.to.to_array(), "radius": cave.radius }));
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

/// A node at a place, with these extras unless they are null.
fn node(name: String, at: Vec3, mesh: Option<Index<Mesh>>, extras: Value) -> Node {
    Node { name: Some(name), translation: Some(at.to_array()), mesh, extras: raw(extras), ..Node::default() }
}

/// Numbers of 32 bits are widened in a [`Value`], so they print with all digits and read back with the same bits.
fn raw(extras: Value) -> Extras {
    (!extras.is_null()).then(|| to_raw_value(&extras).expect("plain data"))
}

/// Collects a glTF document and its binary data.
#[derive(Default)]
struct SceneWriter {
    root: Root,
    binary: Vec<u8>,
    shared: HashMap<&'static str, Index<Mesh>>,
}

impl SceneWriter {
    /// Adds an indexed mesh, with corners welded where their bits are equal; `None` if there are no triangles.
    fn add_mesh(
        &mut self,
        name: &str,
        surface: Surface,
        triangles: impl Iterator<Item = [Vec3; 3]>,
    ) -> Option<Index<Mesh>> {
        let (vertices, corners) = numbered(triangles.flatten());
        let Aabb { low, high } = Aabb::around(vertices.iter().copied())?;
        let positions: Vec<u8> = vertices.iter().flat_map(Vec3::to_array).flat_map(f32::to_le_bytes).collect();
        let indices: Vec<u8> = corners.into_iter().flat_map(u32::to_le_bytes).collect();
        let (min, max) = (Some(json!(low.to_array())), Some(json!(high.to_array())));
        let positions = Accessor { min, max, ..self.add_view(&positions, Target::ArrayBuffer) };
        let indices = self.add_view(&indices, Target::ElementArrayBuffer);
        let primitive = Primitive {
            attributes: BTreeMap::from([(Valid(Semantic::Positions), self.root.push(positions))]),
            extensions: None,
            extras: None,
            indices: Some(self.root.push(indices)),
            material: Some(Index::new(surface as u32)),
            mode: Valid(Mode::Triangles),
            targets: None,
        };
        let (name, primitives) = (Some(name.to_owned()), vec![primitive]);
        Some(self.root.push(Mesh { extensions: None, extras: None, name, primitives, weights: None }))
    }

    /// Returns a mesh that several nodes share, and adds it when it is first needed.
    fn shared_mesh(&mut self, surface: Surface, make: impl Fn() -> Vec<[Vec3; 3]>) -> Index<Mesh> {
        let name = surface.name();
        if let Some(&mesh) = self.shared.get(name) {
            return mesh;
        }
        let mesh = self.add_mesh(name, surface, make().into_iter()).expect("shared meshes have triangles");
        self.shared.insert(name, mesh);
        mesh
    }

    /// Adds a buffer view of positions or indices, and returns an accessor of all that it holds. All values are four
    /// bytes wide, so every view begins at a multiple of four.
    fn add_view(&mut self, bytes: &[u8], target: Target) -> Accessor {
        let (component, kind) = match target {
            Target::ArrayBuffer => (ComponentType::F32, Type::Vec3),
            Target::ElementArrayBuffer => (ComponentType::U32, Type::Scalar),
        };
        let view = self.root.push(View {
            buffer: Index::new(0),
            byte_length: bytes.len().into(),
            byte_offset: Some(self.binary.len().into()),
            byte_stride: None,
            name: None,
            target: Some(Valid(target)),
            extensions: None,
            extras: None,
        });
        self.binary.extend(bytes);
        Accessor {
            buffer_view: Some(view),
            byte_offset: None,
            count: (bytes.len() / (component.size() * kind.multiplicity())).into(),
            component_type: Valid(GenericComponentType(component)),
            extensions: None,
            extras: None,
            type_: Valid(kind),
            min: None,
            max: None,
            name: None,
            normalized: false,
            sparse: None,
        }
    }

    fn add_disc(&mut self, name: String, kind: DeviceKind, centre: Vec3, extras: Value) {
        let mesh = self.shared_mesh(kind.surface(), disc);
        self.root.push(node(name, centre, Some(mesh), extras));
    }

    fn add_empty(&mut self, name: String, at: Vec3, extras: Value) {
        self.root.push(node(name, at, None, extras));
    }

    fn finish(self, MapSize { width, height, depth }: MapSize) -> Vec<u8> {
        let Self { mut root, binary, .. } = self;
        let nodes = (0..root.nodes.len() as u32).map(Index::new).collect();
        let extras = raw(json!({ "surefoot": { "size": [width, height, depth] } }));
        root.scene = Some(root.push(Scene { extensions: None, extras, name: Some("map".to_owned()), nodes }));
        root.asset.generator = Some("Surefoot".to_owned());
        root.materials = Surface::ALL.iter().copied().map(material).collect();
        // glTF does not allow empty buffers.
        let bin = (!binary.is_empty()).then(|| {
            let byte_length = binary.len().into();
            root.push(Buffer { byte_length, name: None, uri: None, extensions: None, extras: None });
            binary.into()
        });
        let json = root.to_vec().expect("plain data").into();
        // The writer computes the length itself.
        let header = Header { magic: *b"glTF", version: 2, length: 0 };
        Glb { header, json, bin }.to_vec().expect("memory takes all bytes")
    }
}

fn material(surface: Surface) -> Material {
    let (colour, glow) = match surface {
        Surface::Ground => ([0.36, 0.33, 0.27, 1.0], [0.0, 0.0, 0.0]),
        Surface::Water => ([0.08, 0.30, 0.55, 0.6], [0.0, 0.0, 0.0]),
        Surface::Lava => ([0.90, 0.20, 0.03, 1.0], [0.8, 0.15, 0.0]),
        Surface::Pad => ([0.95, 0.75, 0.10, 1.0], [0.0, 0.0, 0.0]),
        Surface::ZipLine => ([0.15, 0.70, 0.35, 1.0], [0.0, 0.0, 0.0]),
        Surface::Teleporter => ([0.55, 0.20, 0.80, 1.0], [0.1, 0.0, 0.2]),
        Surface::Jetpack => ([0.85, 0.85, 0.90, 1.0], [0.0, 0.0, 0.0]),
    };
    Material {
        name: Some(surface.name().to_owned()),
        alpha_mode: Valid(if surface == Surface::Water { AlphaMode::Blend } else { AlphaMode::Opaque }),
        pbr_metallic_roughness: PbrMetallicRoughness {
            base_color_factor: PbrBaseColorFactor(colour),
            metallic_factor: StrengthFactor(0.0),
            roughness_factor: StrengthFactor(0.9),
            ..PbrMetallicRoughness::default()
        },
        emissive_factor: EmissiveFactor(glow),
        ..Material::default()
    }
}
