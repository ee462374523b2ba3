//! Reads glTF 2.0 into a scene: nodes with their transforms applied, in double precision.
//!
//! The JSON becomes the types of `document`; every index is checked on use, and what it leads to is read by
//! `accessors`. `shape` makes the triangles of a mesh; this file walks the nodes and reads their animations.

use crate::accessors::{Layout, Source, data_error, reference};
use crate::animated::Animation;
use crate::container::{Files, split};
use crate::document::{self, Document};
use crate::faults::{ImportError, MAX_TRIANGLES};
use crate::scene::{ImportOptions, Node, Scene, node_label};
use crate::shape::Shaper;
use glam::{DMat4, DQuat, DVec3, Quat, Vec3};
use serde::Deserialize;
use surefoot_world::map::{MapSize, UpAxis};

/// Most objects in the JSON of a glTF.
const MAX_OBJECTS: usize = 2_000_000;
/// Extensions that may change geometry and are read.
const READ_EXTENSIONS: [&str; 6] = [
    "EXT_mesh_gpu_instancing",
    "EXT_meshopt_compression",
    "KHR_draco_mesh_compression",
    "KHR_mesh_quantization",
    "KHR_meshopt_compression",
    "KHR_node_visibility",
];
/// How extensions begin that change no geometry, so that a level may require them.
const HARMLESS_EXTENSIONS: [&str; 26] = [
    "KHR_materials_",
    "KHR_texture_",
    "KHR_lights_",
    "KHR_animation_",
    "ADOBE_materials",
    "AGI_",
    "CESIUM_primitive_outline",
    "EXT_instance_features",
    "EXT_mesh_features",
    "EXT_structural_metadata",
    "FB_ngon_encoding",
    "GODOT_",
    "KHR_audio",
    "KHR_environment_map",
    "KHR_implicit_shapes",
    "KHR_node_",
    "MOZ_",
    "VRM",
    "KHR_interactivity",
    "KHR_physics_",
    "KHR_xmp",
    "EXT_texture_",
    "EXT_lights_",
    "EXT_materials_",
    "MSFT_",
    "OMI_",
];

/// Reads a glTF: the nodes of its default scene, or those of all scenes.
pub(super) fn read(bytes: &[u8], options: &ImportOptions, files: &dyn Files) -> Result<Scene, ImportError> {
    let (json, binary) = split(bytes)?;
    // An object of two bytes becomes a node of hundreds.
    if json.iter().filter(|byte| **byte == b'{').count() > MAX_OBJECTS {
        return Err(ImportError::TooManyObjects);
    }
    let root: Document = serde_json::from_slice(json).map_err(|error| ImportError::Json(error.to_string()))?;
    if !root.asset.version.starts_with("2.") {
        return Err(ImportError::GltfVersion(root.asset.version));
    }
    check_extensions(&root)?;
    let source = Source::new(&root, binary, files)?;
    let up = match options.up {
        UpAxis::Y => Vec3::Y,
        UpAxis::Z => Vec3::Z,
    };
    Reader { source: &source, triangle_budget: MAX_TRIANGLES, up }.scene(options.all_scenes)
}

fn check_extensions(root: &Document) -> Result<(), ImportError> {
    let is_known = |name: &String| {
        READ_EXTENSIONS.contains(&name.as_str()) || HARMLESS_EXTENSIONS.iter().any(|start| name.starts_with(start))
    };
    // Other extensions that are used but not required come with a fallback.
    let unknown = root.extensions_required.iter().find(|name| !is_known(name));
    unknown.map_or(Ok(()), |name| Err(ImportError::Extension(name.clone())))
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

/// Where a node of the file is in the scene.
#[derive(Clone, Copy)]
struct Placed {
    own_idx: usize,
    level_from_parent: DMat4,
    level_from_node: DMat4,
}

struct Reader<'a> {
    source: &'a Source<'a>,
    /// Triangles that may still be added; a mesh counts once for each node that uses it.
    triangle_budget: usize,
    /// The level's upright axis.
    up: Vec3,
}

impl Reader<'_> {
    fn scene(mut self, all_scenes: bool) -> Result<Scene, ImportError> {
        let root = self.source.root;
        let scene_idx = root.scene.unwrap_or(0);
        let scene = root.scenes.get(scene_idx);
        if scene.is_none() && root.scene.is_some() {
            return Err(reference("the file", "scene", scene_idx));
        }
        let extras = scene.and_then(|scene| scene.extras.as_ref());
        let former_size = extras
            .and_then(|extras| serde_json::from_str::<SceneExtras>(extras.get()).ok()?.surefoot)
            .map(|SurefootExtras { size: [width, height, depth] }| MapSize { width, height, depth });
        let roots: Vec<usize> = match scene {
            Some(_) if all_scenes => {
                let mut roots: Vec<usize> = root.scenes.iter().flat_map(|scene| scene.nodes.iter().copied()).collect();
                // Scenes may share nodes.
                roots.sort_unstable();
                roots.dedup();
                roots
            }
            Some(scene) => scene.nodes.clone(),
            None => nodes_without_parent(root),
        };

        let mut nodes = Vec::new();
        let mut placed: Vec<Option<Placed>> = vec![None; root.nodes.len()];
        // An explicit stack, since the file decides how deeply nodes are nested.
        let mut waiting: Vec<(usize, Option<usize>, DMat4)> =
            roots.into_iter().rev().map(|idx| (idx, None, DMat4::IDENTITY)).collect();
        while let Some((idx, parent, level_from_parent)) = waiting.pop() {
            let from = || parent.map_or("the scene".to_owned(), |parent: usize| label(&nodes, parent));
            let node = root.nodes.get(idx).ok_or_else(|| reference(&from(), "node", idx))?;
            if placed[idx].is_some() {
                return Err(ImportError::NotATree { node: node_label(&node.name, idx) });
            }
            let level_from_node = level_from_parent * parent_from_node(node);
            let own_idx = nodes.len();
            placed[idx] = Some(Placed { own_idx, level_from_parent, level_from_node });
            nodes.push(Node {
                name: node.name.clone(),
                file_idx: idx,
                parent,
                origin: level_from_node.transform_point3(DVec3::ZERO),
                extras: node.extras.clone(),
                is_hidden: node.extensions.visibility.as_ref().is_some_and(|it| !it.visible),
                is_skinned: node.skin.is_some(),
                ..Node::default()
            });
            waiting.extend(node.children.iter().rev().map(|child| (*child, Some(own_idx), level_from_node)));
        }
        self.add_triangles(&mut nodes, &placed)?;
        self.animate(&mut nodes, &placed)?;
        Ok(Scene { nodes, former_size })
    }

    /// Reads the meshes. All nodes are placed before: a skin may follow any of them.
    fn add_triangles(&mut self, nodes: &mut [Node<DVec3>], placed: &[Option<Placed>]) -> Result<(), ImportError> {
        let root = self.source.root;
        let level_from = |idx: usize| placed.get(idx).copied().flatten().map(|placed| placed.level_from_node);
        let mut shaper = Shaper::new(self.source, &mut self.triangle_budget, &level_from);
        for own in nodes.iter_mut() {
            let node = &root.nodes[own.file_idx];
            let Some(level_from_node) = level_from(own.file_idx).filter(|_| node.mesh.is_some()) else { continue };
            let label = node_label(&own.name, own.file_idx);
            let shape = shaper.shape(&label, node, level_from_node)?;
            (own.triangles, own.skipped_count) = (shape.triangles, shape.skipped_count);
        }
        Ok(())
    }

    /// Reads how nodes with triangles at or below them are shifted and turned; bones and cameras have none. Of several
    /// animations of a node the first counts.
    fn animate(&mut self, nodes: &mut [Node<DVec3>], placed: &[Option<Placed>]) -> Result<(), ImportError> {
        let mut is_shown: Vec<bool> = nodes.iter().map(|node| !node.triangles.is_empty()).collect();
        // Parents come before their children.
        for (idx, node) in nodes.iter().enumerate().rev() {
            if let Some(parent) = node.parent {
                is_shown[parent] |= is_shown[idx];
            }
        }
        for animation in &self.source.root.animations {
            for channel in &animation.channels {
                let Some(target) = channel.target.node else { continue };
                let placed = placed.get(target).copied().flatten().filter(|placed| is_shown[placed.own_idx]);
                if let Some(placed) = placed {
                    self.add_channel(animation, channel, &mut nodes[placed.own_idx], placed.level_from_parent)?;
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

    /// Reads one channel into its node, whose parent is at `level_from_parent`.
    fn add_channel(
        &mut self,
        animation: &document::Animation,
        channel: &document::Channel,
        node: &mut Node<DVec3>,
        level_from_parent: DMat4,
    ) -> Result<(), ImportError> {
        let from = format!("the animation of {}", node_label(&node.name, node.file_idx));
        let missing = || reference(&from, "sampler", channel.sampler);
        let sampler = animation.samplers.get(channel.sampler).ok_or_else(missing)?;
        let rest = parent_from_node(&self.source.root.nodes[node.file_idx]);
        match channel.target.path.as_str() {
            "translation" => {
                let keys = self.keys::<3>(&from, sampler)?;
                let animated = node.animation.get_or_insert_default();
                if animated.shifts.is_empty() {
                    let shift = |place: [f32; 3]| {
                        let offset = Vec3::from(place).as_dvec3() - rest.w_axis.truncate();
                        level_from_parent.transform_vector3(offset).as_vec3()
                    };
                    animated.shifts = keys.into_iter().map(|(at, place)| (at, shift(place))).collect();
                }
            }
            "rotation" => {
                let keys = self.keys::<4>(&from, sampler)?;
                let animated = node.animation.get_or_insert_default();
                if animated.turns.is_empty() {
                    let (_, at_rest, _) = rest.to_scale_rotation_translation();
                    // What is scaled to nothing has no rotation.
                    let at_rest = if at_rest.is_finite() { at_rest.as_quat() } else { Quat::IDENTITY };
                    let (_, level_from_parent, _) = level_from_parent.to_scale_rotation_translation();
                    let level_from_parent =
                        if level_from_parent.is_finite() { level_from_parent.as_quat() } else { Quat::IDENTITY };
                    let up = level_from_parent.inverse() * self.up;
                    let turn = |to: [f32; 4]| {
                        let by = Quat::from_array(to) * at_rest.inverse();
                        2.0 * libm::atan2f(Vec3::new(by.x, by.y, by.z).dot(up), by.w)
                    };
                    animated.turns = keys.into_iter().map(|(at, to)| (at, nearest_turn(turn(to)))).collect();
                }
            }
            _ => {}
        }
        Ok(())
    }

    /// The times of a sampler, s, and the values of `N` numbers at them.
    fn keys<const N: usize>(
        &mut self,
        from: &str,
        sampler: &document::Sampler,
    ) -> Result<Vec<(f32, [f32; N])>, ImportError> {
        let times = self.source.elements(from, sampler.input, Layout::Floats(1))?;
        let values = self.source.elements(from, sampler.output, Layout::Floats(N))?;
        // Keys are bounded like triangles: an accessor may be read again and again.
        self.triangle_budget = self.triangle_budget.checked_sub(times.count).ok_or(ImportError::TooManyTriangles)?;
        // A spline has a tangent before and after each value.
        let is_spline = sampler.interpolation == "CUBICSPLINE";
        let value_idx = |idx: usize| if is_spline { 3 * idx + 1 } else { idx };
        let mut keys = Vec::with_capacity(times.count);
        for idx in 0..times.count {
            let (time, value) = (times.floats::<1>(idx), values.floats::<N>(value_idx(idx)));
            let missing = || data_error(from, "fewer values than times: export the level again");
            keys.push((time.ok_or_else(missing)?[0], value.ok_or_else(missing)?));
        }
        Ok(keys)
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

fn nodes_without_parent(root: &Document) -> Vec<usize> {
    let mut is_root = vec![true; root.nodes.len()];
    for child in root.nodes.iter().flat_map(|node| &node.children) {
        if let Some(is_root) = is_root.get_mut(*child) {
            *is_root = false;
        }
    }
    (0..is_root.len()).filter(|&idx| is_root[idx]).collect()
}

fn label(nodes: &[Node<DVec3>], idx: usize) -> String {
    node_label(&nodes[idx].name, nodes[idx].file_idx)
}

fn parent_from_node(node: &document::Node) -> DMat4 {
    if let Some(columns) = node.matrix {
        return DMat4::from_cols_array(&columns);
    }
    let scale = node.scale.map_or(DVec3::ONE, DVec3::from);
    let translation = node.translation.map_or(DVec3::ZERO, DVec3::from);
    let rotation = node.rotation.map_or(DQuat::IDENTITY, DQuat::from_array);
    // Normalizing a zero rotation would give NaN.
    let rotation = if rotation.length_squared() > 0.0 { rotation.normalize() } else { DQuat::IDENTITY };
    DMat4::from_scale_rotation_translation(scale, rotation, translation)
}
