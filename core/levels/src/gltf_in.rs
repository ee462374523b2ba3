//! Reads glTF 2.0 into a scene: nodes with their transforms applied.
//!
//! The JSON is parsed into the types of the `gltf` crate, but without its wrappers: those trust indices and lengths,
//! and the crate's own validation indexes with a number from the file. Here every index is checked on use, and what it
//! leads to is read by `accessors`.

use crate::accessors::{Layout, Source, data_error, split_glb};
use crate::animated::Animation;
use crate::faults::{ImportError, MAX_TRIANGLES};
use crate::meshopt;
use crate::scene::{Node, Scene, node_label};
use glam::{Mat4, Quat};
use gltf::json::animation::{Interpolation, Property};
use gltf::json::mesh::{Mode, Primitive, Semantic};
use gltf::json::validation::Checked;
use gltf::json::{self, Index, Root};
use serde::Deserialize;
use surefoot_world::Vec3;
use surefoot_world::map::MapSize;

/// Extension that repeats a mesh, without a fallback for programs that do not support it.
const INSTANCING_EXTENSION: &str = "EXT_mesh_gpu_instancing";
/// Extension that allows positions of other types than 32-bit floats.
const QUANTIZATION_EXTENSION: &str = "KHR_mesh_quantization";
/// Prefixes of extensions that only change the appearance, so that a level may require them.
const APPEARANCE_EXTENSIONS: [&str; 5] =
    ["KHR_materials_", "KHR_texture_", "KHR_lights_", "EXT_texture_", "EXT_lights_"];

pub(super) fn read(bytes: &[u8]) -> Result<Scene, ImportError> {
    let (json, binary) = if bytes.starts_with(b"glTF") { split_glb(bytes)? } else { (bytes, None) };
    let root = Root::from_slice(json).map_err(|error| ImportError::Json(error.to_string()))?;
    if !root.asset.version.starts_with("2.") {
        return Err(ImportError::GltfVersion(root.asset.version.clone()));
    }
    check_extensions(&root)?;
    let source = Source::new(&root, binary)?;
    Reader { source: &source, triangle_budget: MAX_TRIANGLES, skipped_count: 0 }.scene()
}

fn check_extensions(root: &Root) -> Result<(), ImportError> {
    let is_appearance = |name: &str| APPEARANCE_EXTENSIONS.iter().any(|start| name.starts_with(start));
    // Other extensions that are used but not required come with a fallback.
    let instancing = root.extensions_used.iter().find(|name| *name == INSTANCING_EXTENSION);
    let is_known = |name: &String| {
        name == QUANTIZATION_EXTENSION || meshopt::EXTENSIONS.contains(&name.as_str()) || is_appearance(name)
    };
    let unknown = root.extensions_required.iter().find(|name| !is_known(name));
    instancing.or(unknown).map_or(Ok(()), |name| Err(ImportError::Extension(name.clone())))
}

/// Extras that an export writes to its scene.
#[derive(Deserialize)]
struct SceneExtras {
    surefoot: Option<SurefootExtras>,
}

#[derive(Deserialize)]
struct SurefootExtras {
    size: [u32; 3],
}

struct Reader<'a> {
    source: &'a Source<'a>,
    /// Triangles that may still be added; a mesh counts once for each node that uses it.
    triangle_budget: usize,
    skipped_count: usize,
}

impl Reader<'_> {
    fn scene(mut self) -> Result<Scene, ImportError> {
        let root = self.source.root;
        let scene_idx = root.scene.map_or(0, |scene| scene.value());
        let scene = root.scenes.get(scene_idx);
        if scene.is_none() && root.scene.is_some() {
            return Err(ImportError::Reference { from: "the file".to_owned(), to: "scene", idx: scene_idx });
        }
        let extras = scene.and_then(|scene| scene.extras.as_ref());
        let former_size = extras
            .and_then(|extras| serde_json::from_str::<SceneExtras>(extras.get()).ok()?.surefoot)
            .map(|SurefootExtras { size: [width, height, depth] }| MapSize { width, height, depth });
        let roots: Vec<usize> = match scene {
            Some(scene) => scene.nodes.iter().map(Index::value).collect(),
            None => nodes_without_parent(root),
        };

        let mut nodes = Vec::new();
        // The node of each index in the file, and where its parent is.
        let mut placed: Vec<Option<(usize, Mat4)>> = vec![None; root.nodes.len()];
        let mut is_visited = vec![false; root.nodes.len()];
        // An explicit stack, since the file decides how deeply nodes are nested.
        let mut waiting: Vec<(usize, Option<usize>, Mat4)> =
            roots.into_iter().rev().map(|idx| (idx, None, Mat4::IDENTITY)).collect();
        while let Some((idx, parent, level_from_parent)) = waiting.pop() {
            let from = || parent.map_or("the scene".to_owned(), |parent: usize| label(&nodes, parent));
            let node = root.nodes.get(idx).ok_or_else(|| ImportError::Reference { from: from(), to: "node", idx })?;
            let name = node.name.clone().unwrap_or_default();
            if std::mem::replace(&mut is_visited[idx], true) {
                return Err(ImportError::NotATree { node: node_label(&name, idx) });
            }
            let level_from_node = level_from_parent * parent_from_node(node);
            let triangles = match node.mesh {
                Some(mesh) => self.triangles(&node_label(&name, idx), mesh, level_from_node)?,
                None => Vec::new(),
            };
            let origin = level_from_node.transform_point3(Vec3::ZERO);
            let own_idx = nodes.len();
            placed[idx] = Some((own_idx, level_from_parent));
            nodes.push(Node { name, parent, origin, triangles, extras: node.extras.clone(), animation: None });
            let children = node.children.iter().flatten().rev();
            waiting.extend(children.map(|child| (child.value(), Some(own_idx), level_from_node)));
        }
        self.animate(&mut nodes, &placed)?;
        Ok(Scene { nodes, former_size, skipped_count: self.skipped_count })
    }

    /// Reads how nodes with triangles at or below them are shifted and turned; bones and cameras have none. Of several
    /// animations of a node the first counts.
    fn animate(&mut self, nodes: &mut [Node], placed: &[Option<(usize, Mat4)>]) -> Result<(), ImportError> {
        let mut is_shown: Vec<bool> = nodes.iter().map(|node| !node.triangles.is_empty()).collect();
        // Parents come before their children.
        for (idx, node) in nodes.iter().enumerate().rev() {
            if let Some(parent) = node.parent {
                is_shown[parent] |= is_shown[idx];
            }
        }
        for animation in &self.source.root.animations {
            for channel in &animation.channels {
                let target = channel.target.node.value();
                let placed = placed.get(target).copied().flatten().filter(|(own_idx, _)| is_shown[*own_idx]);
                if let Some(placed) = placed {
                    self.add_channel(animation, channel, nodes, placed)?;
                }
            }
        }
        let is_finite = |animation: &Animation| {
            animation.shifts.iter().all(|(at, shift)| at.is_finite() && shift.is_finite())
                && animation.turns.iter().all(|(at, turn)| at.is_finite() && turn.is_finite())
        };
        let broken = nodes.iter().position(|node| node.animation.as_ref().is_some_and(|it| !is_finite(it)));
        broken.map_or(Ok(()), |idx| Err(ImportError::NotFinite { node: label(nodes, idx) }))
    }

    /// Reads one channel into the node at `own_idx`, whose parent is at `level_from_parent`.
    fn add_channel(
        &mut self,
        animation: &json::Animation,
        channel: &json::animation::Channel,
        nodes: &mut [Node],
        (own_idx, level_from_parent): (usize, Mat4),
    ) -> Result<(), ImportError> {
        let from = format!("the animation of {}", label(nodes, own_idx));
        let sampler = channel.sampler.value();
        let reference = || ImportError::Reference { from: from.clone(), to: "sampler", idx: sampler };
        let sampler = animation.samplers.get(sampler).ok_or_else(reference)?;
        let width = match channel.target.path {
            Checked::Valid(Property::Translation) => 3,
            Checked::Valid(Property::Rotation) => 4,
            _ => return Ok(()),
        };
        let keys = self.keys(&from, sampler, width)?;
        let rest = parent_from_node(&self.source.root.nodes[channel.target.node.value()]);
        let animated = nodes[own_idx].animation.get_or_insert_default();
        if width == 3 && animated.shifts.is_empty() {
            let shift = |place: [f32; 4]| {
                let offset = Vec3::new(place[0], place[1], place[2]) - rest.w_axis.truncate();
                level_from_parent.transform_vector3(offset)
            };
            animated.shifts = keys.into_iter().map(|(at, place)| (at, shift(place))).collect();
        } else if width == 4 && animated.turns.is_empty() {
            let (_, at_rest, _) = rest.to_scale_rotation_translation();
            // What is scaled to nothing has no rotation.
            let at_rest = if at_rest.is_finite() { at_rest } else { Quat::IDENTITY };
            let turn = |to: [f32; 4]| {
                let by = Quat::from_array(to) * at_rest.inverse();
                2.0 * libm::atan2f(by.y, by.w)
            };
            animated.turns = keys.into_iter().map(|(at, to)| (at, nearest_turn(turn(to)))).collect();
        }
        Ok(())
    }

    /// The times of a sampler, s, and the values of `width` numbers at them.
    fn keys(
        &mut self,
        from: &str,
        sampler: &json::animation::Sampler,
        width: usize,
    ) -> Result<Vec<(f32, [f32; 4])>, ImportError> {
        let times = self.source.elements(from, sampler.input.value(), Layout::Floats(1))?;
        let values = self.source.elements(from, sampler.output.value(), Layout::Floats(width))?;
        // Keys are bounded like triangles: an accessor may be read again and again.
        self.triangle_budget = self.triangle_budget.checked_sub(times.count).ok_or(ImportError::TooManyTriangles)?;
        // A spline has a tangent before and after each value.
        let is_spline = sampler.interpolation == Checked::Valid(Interpolation::CubicSpline);
        let value_idx = |idx: usize| if is_spline { 3 * idx + 1 } else { idx };
        let mut keys = Vec::with_capacity(times.count);
        for idx in 0..times.count {
            let (time, value) = (times.floats(idx, 1), values.floats(value_idx(idx), width));
            let missing = || data_error(from, "fewer values than times: export the level again");
            keys.push((time.ok_or_else(missing)?[0], value.ok_or_else(missing)?));
        }
        Ok(keys)
    }

    /// Triangles of all primitives of a mesh, in the level's coordinates.
    fn triangles(
        &mut self,
        from: &str,
        mesh: Index<json::Mesh>,
        level_from_node: Mat4,
    ) -> Result<Vec<[Vec3; 3]>, ImportError> {
        let reference = || ImportError::Reference { from: from.to_owned(), to: "mesh", idx: mesh.value() };
        let json = self.source.root.meshes.get(mesh.value()).ok_or_else(reference)?;
        let label = match &json.name {
            Some(name) if !name.is_empty() => format!("mesh `{name}`"),
            _ => format!("the mesh of {from}"),
        };
        let mut triangles = Vec::new();
        for primitive in &json.primitives {
            self.add_primitive(&label, primitive, level_from_node, &mut triangles)?;
        }
        Ok(triangles)
    }

    fn add_primitive(
        &mut self,
        mesh: &str,
        primitive: &Primitive,
        level_from_node: Mat4,
        triangles: &mut Vec<[Vec3; 3]>,
    ) -> Result<(), ImportError> {
        let Checked::Valid(mode) = primitive.mode else {
            return Err(data_error(mesh, "an unknown primitive mode: export the level again"));
        };
        // Every primitive costs one triangle, so that the work is bounded even if it has none.
        self.triangle_budget = self.triangle_budget.checked_sub(1).ok_or(ImportError::TooManyTriangles)?;
        if !matches!(mode, Mode::Triangles | Mode::TriangleStrip | Mode::TriangleFan) {
            self.skipped_count += 1;
            return Ok(());
        }
        let positions = primitive.attributes.get(&Checked::Valid(Semantic::Positions));
        let positions = positions.ok_or_else(|| data_error(mesh, "no positions: export the level again"))?;
        let positions = self.source.elements(mesh, positions.value(), Layout::Positions)?;
        let indices = primitive
            .indices
            .map(|indices| self.source.elements(mesh, indices.value(), Layout::Indices))
            .transpose()?;
        let count = indices.as_ref().map_or(positions.count, |indices| indices.count);
        let triangle_count = if mode == Mode::Triangles { count / 3 } else { count.saturating_sub(2) };
        self.triangle_budget = self.triangle_budget.checked_sub(triangle_count).ok_or(ImportError::TooManyTriangles)?;

        let corner = |i: usize| {
            let vertex = indices.as_ref().map_or(i as u32, |indices| indices.index(i));
            let out_of_range =
                || ImportError::VertexOutOfRange { mesh: mesh.to_owned(), vertex, count: positions.count };
            let point = positions.position(vertex as usize).ok_or_else(out_of_range)?;
            let point = level_from_node.transform_point3(point);
            if point.is_finite() { Ok(point) } else { Err(ImportError::NotFinite { node: mesh.to_owned() }) }
        };
        // A mirroring transform turns triangles inside out (glTF 2.0, section 3.7.4).
        let is_mirrored = level_from_node.determinant() < 0.0;
        triangles.reserve(triangle_count);
        for i in 0..triangle_count {
            let [a, b, c] = match mode {
                Mode::TriangleStrip => [i, i + 1 + i % 2, i + 2 - i % 2],
                Mode::TriangleFan => [i + 1, i + 2, 0],
                _ => [3 * i, 3 * i + 1, 3 * i + 2],
            };
            let (b, c) = if is_mirrored { (c, b) } else { (b, c) };
            triangles.push([corner(a)?, corner(b)?, corner(c)?]);
        }
        Ok(())
    }
}

/// The same angle within half a turn, rad: a quaternion and its negative are one rotation.
fn nearest_turn(angle: f32) -> f32 {
    use std::f32::consts::{PI, TAU};
    if angle > PI {
        angle - TAU
    } else if angle < -PI {
        angle + TAU
    } else {
        angle
    }
}

fn nodes_without_parent(root: &Root) -> Vec<usize> {
    let mut is_root = vec![true; root.nodes.len()];
    for child in root.nodes.iter().flat_map(|node| node.children.iter().flatten()) {
        if let Some(is_root) = is_root.get_mut(child.value()) {
            *is_root = false;
        }
    }
    (0..is_root.len()).filter(|&idx| is_root[idx]).collect()
}

fn label(nodes: &[Node], idx: usize) -> String {
    node_label(&nodes[idx].name, idx)
}

fn parent_from_node(node: &json::Node) -> Mat4 {
    if let Some(columns) = node.matrix {
        return Mat4::from_cols_array(&columns);
    }
    let scale = node.scale.map_or(Vec3::ONE, Vec3::from);
    let translation = node.translation.map_or(Vec3::ZERO, Vec3::from);
    let rotation = node.rotation.map_or(Quat::IDENTITY, |rotation| Quat::from_array(rotation.0));
    // Normalizing a zero rotation would give NaN.
    let rotation = if rotation.length_squared() > 0.0 { rotation.normalize() } else { Quat::IDENTITY };
    Mat4::from_scale_rotation_translation(scale, rotation, translation)
}
