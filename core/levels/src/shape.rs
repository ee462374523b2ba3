//! The triangles of a glTF's meshes: primitives, morph targets, skins and instances.

use crate::accessors::{Elements, Layout, Source, data_error, reference};
use crate::document::{Accessor, Instancing, Mesh, Node, Primitive};
use crate::draco::{self, Draco, DracoMesh};
use crate::faults::ImportError;
use glam::{DMat4, DQuat, DVec3, Vec3};
use std::collections::BTreeMap;
use std::rc::Rc;

/// Modes of primitives that are surfaces (glTF 2.0, section 5.24.4).
const TRIANGLES: u32 = 4;
const TRIANGLE_STRIP: u32 = 5;
const TRIANGLE_FAN: u32 = 6;
/// Most sets of four joints that move a vertex.
const MOST_JOINT_SETS: usize = 4;

/// What a node's mesh is made of, in the level's coordinates.
#[derive(Default)]
pub(super) struct Shape {
    pub triangles: Vec<[DVec3; 3]>,
    /// Number of point and line primitives, which are left out.
    pub skipped_count: usize,
}

/// Reads the shapes of nodes.
pub(super) struct Shaper<'a> {
    source: &'a Source<'a>,
    /// Triangles that may still be added; a mesh counts once for each node and instance that uses it.
    budget: &'a mut usize,
    /// The transform of a node of the file in the level; `None` if it is not in the scene.
    level_from: &'a dyn Fn(usize) -> Option<DMat4>,
    /// Decoded Draco meshes by their views, since nodes share meshes.
    decoded: BTreeMap<usize, Rc<DracoMesh>>,
}

/// How a node places its mesh.
struct Pose {
    /// The transform of each instance.
    instances: Vec<DMat4>,
    /// The transform of each joint of a skin. They replace the node's own transform.
    joints: Option<Vec<DMat4>>,
    /// Weights of the morph targets.
    weights: Vec<f32>,
}

impl<'a> Shaper<'a> {
    pub(super) fn new(
        source: &'a Source<'a>,
        budget: &'a mut usize,
        level_from: &'a dyn Fn(usize) -> Option<DMat4>,
    ) -> Self {
        Self { source, budget, level_from, decoded: BTreeMap::new() }
    }

    /// Takes from the budget.
    fn spend(&mut self, count: usize) -> Result<(), ImportError> {
        *self.budget = self.budget.checked_sub(count).ok_or(ImportError::TooManyTriangles)?;
        Ok(())
    }

    /// The shape of a node, which is at `level_from_node` and called `from` in messages.
    pub(super) fn shape(&mut self, from: &str, node: &Node, level_from_node: DMat4) -> Result<Shape, ImportError> {
        let Some(mesh_idx) = node.mesh else { return Ok(Shape::default()) };
        let source = self.source;
        let mesh: &Mesh = source.root.meshes.get(mesh_idx).ok_or_else(|| reference(from, "mesh", mesh_idx))?;
        let label = if mesh.name.is_empty() { format!("the mesh of {from}") } else { format!("mesh `{}`", mesh.name) };
        let pose = Pose {
            instances: match &node.extensions.instancing {
                Some(instancing) => self.instances(from, instancing, level_from_node)?,
                None => vec![level_from_node],
            },
            joints: node.skin.map(|skin| self.joints(from, skin)).transpose()?,
            weights: node.weights.clone().unwrap_or_else(|| mesh.weights.clone()),
        };
        let mut shape = Shape::default();
        for primitive in &mesh.primitives {
            self.add_primitive(&label, primitive, &pose, &mut shape)?;
        }
        Ok(shape)
    }

    /// The transforms of a mesh that is repeated.
    fn instances(
        &mut self,
        from: &str,
        instancing: &Instancing,
        level_from_node: DMat4,
    ) -> Result<Vec<DMat4>, ImportError> {
        let read = |idx: Option<usize>, width| {
            idx.map(|idx| self.source.elements(from, idx, Layout::Floats(width))).transpose()
        };
        let attributes = &instancing.attributes;
        let (shifts, turns) = (read(attributes.translation, 3)?, read(attributes.rotation, 4)?);
        let scales = read(attributes.scale, 3)?;
        let count = [&shifts, &turns, &scales].into_iter().flatten().map(|elements| elements.count).max().unwrap_or(0);
        self.spend(count)?;
        let missing = || data_error(from, "instances of different numbers: export the level again");
        let vector = |elements: &Option<Elements<'_>>, idx, default| match elements {
            Some(elements) => elements.floats::<3>(idx).map(|it| Vec3::from(it).as_dvec3()).ok_or_else(missing),
            None => Ok(default),
        };
        let instance = |idx| {
            let turn = match &turns {
                Some(turns) => DQuat::from_array(turns.floats::<4>(idx).ok_or_else(missing)?.map(f64::from)),
                None => DQuat::IDENTITY,
            };
            let turn = if turn.length_squared() > 0.0 { turn.normalize() } else { DQuat::IDENTITY };
            let (shift, scale) = (vector(&shifts, idx, DVec3::ZERO)?, vector(&scales, idx, DVec3::ONE)?);
            Ok(level_from_node * DMat4::from_scale_rotation_translation(scale, turn, shift))
        };
        (0..count).map(instance).collect()
    }

    /// The transforms of the joints of a skin: from where it was bound to where the joints are.
    fn joints(&mut self, from: &str, skin_idx: usize) -> Result<Vec<DMat4>, ImportError> {
        let skin = self.source.root.skins.get(skin_idx).ok_or_else(|| reference(from, "skin", skin_idx))?;
        self.spend(skin.joints.len())?;
        let bound =
            skin.inverse_bind_matrices.map(|idx| self.source.elements(from, idx, Layout::Floats(16))).transpose()?;
        let missing = || data_error(from, "fewer bind matrices than joints: export the level again");
        let joint = |(place, joint): (usize, &usize)| {
            let level_from_joint = (self.level_from)(*joint).ok_or_else(|| reference(from, "joint", *joint))?;
            Ok(match &bound {
                Some(bound) => {
                    let columns = bound.floats::<16>(place).ok_or_else(missing)?.map(f64::from);
                    level_from_joint * DMat4::from_cols_array(&columns)
                }
                None => level_from_joint,
            })
        };
        skin.joints.iter().enumerate().map(joint).collect()
    }

    fn add_primitive(
        &mut self,
        mesh: &str,
        primitive: &Primitive,
        pose: &Pose,
        shape: &mut Shape,
    ) -> Result<(), ImportError> {
        // What Draco compresses is single triangles, even of a strip.
        let is_draco = primitive.extensions.draco.is_some();
        let mode = primitive.mode.filter(|_| !is_draco).unwrap_or(TRIANGLES);
        // Every primitive costs one triangle, so that the work is bounded even if it has none.
        self.spend(1)?;
        // Primitives without positions are skipped (glTF 2.0, section 3.7.2.1).
        let has_positions = is_draco || primitive.attributes.contains_key("POSITION");
        if mode < TRIANGLES || !has_positions {
            shape.skipped_count += 1;
            return Ok(());
        }
        if mode > TRIANGLE_FAN {
            return Err(data_error(mesh, "an unknown primitive mode: export the level again"));
        }
        let surface = self.surface(mesh, primitive, pose)?;
        let count = surface.indices.as_ref().map_or(surface.vertices.count(), Indices::count);
        let triangle_count = if mode == TRIANGLES { count / 3 } else { count.saturating_sub(2) };
        let wanted = triangle_count.checked_mul(pose.instances.len()).ok_or(ImportError::TooManyTriangles)?;
        if wanted == 0 {
            return Ok(());
        }
        // A vertex with morph targets and joints takes as long as several.
        self.spend(wanted.saturating_mul(surface.vertices.parts()))?;
        shape.triangles.reserve(wanted);
        for level_from_mesh in &pose.instances {
            let placed = |corner: usize| surface.corner(mesh, corner, *level_from_mesh, pose);
            // A mirroring transform turns triangles inside out (glTF 2.0, section 3.7.4).
            let transform = pose.joints.as_ref().and_then(|joints| joints.first()).unwrap_or(level_from_mesh);
            let is_mirrored = transform.determinant() < 0.0;
            for i in 0..triangle_count {
                let [a, b, c] = match mode {
                    TRIANGLE_STRIP => [i, i + 1 + i % 2, i + 2 - i % 2],
                    TRIANGLE_FAN => [i + 1, i + 2, 0],
                    _ => [3 * i, 3 * i + 1, 3 * i + 2],
                };
                let (b, c) = if is_mirrored { (c, b) } else { (b, c) };
                shape.triangles.push([placed(a)?, placed(b)?, placed(c)?]);
            }
        }
        Ok(())
    }

    /// The vertices and indices of a primitive.
    fn surface(&mut self, mesh: &str, primitive: &Primitive, pose: &Pose) -> Result<Surface<'a>, ImportError> {
        if let Some(draco) = &primitive.extensions.draco {
            let mesh = self.decoded(mesh, primitive, draco)?;
            return Ok(Surface { indices: Some(Indices::Decoded(mesh.clone())), vertices: Vertices::Decoded(mesh) });
        }
        let source = self.source;
        let read = |name: &str, layout| {
            let idx = primitive.attributes.get(name);
            idx.map(|idx| source.elements(mesh, *idx, layout)).transpose()
        };
        let positions = read("POSITION", Layout::Positions)?;
        let positions = positions.ok_or_else(|| data_error(mesh, "no positions: export the level again"))?;
        self.spend(primitive.targets.len())?;
        let mut morphs = Vec::new();
        for (target, weight) in primitive.targets.iter().zip(&pose.weights).filter(|(_, weight)| **weight != 0.0) {
            if let Some(idx) = target.get("POSITION") {
                morphs.push((*weight, source.elements(mesh, *idx, Layout::Positions)?));
            }
        }
        let mut influences = Vec::new();
        for set in (0..MOST_JOINT_SETS).take_while(|_| pose.joints.is_some()) {
            let joints = read(&format!("JOINTS_{set}"), Layout::Joints)?;
            let weights = read(&format!("WEIGHTS_{set}"), Layout::Floats(4))?;
            let Some(pair) = joints.zip(weights) else { break };
            influences.push(pair);
        }
        let indices = primitive.indices.map(|idx| source.elements(mesh, idx, Layout::Indices)).transpose()?;
        let vertices = Vertices::Stored { positions, morphs, influences };
        Ok(Surface { vertices, indices: indices.map(Indices::Stored) })
    }

    /// What Draco compressed, with normalized positions as fractions.
    fn decoded(&mut self, mesh: &str, primitive: &Primitive, draco: &Draco) -> Result<Rc<DracoMesh>, ImportError> {
        if let Some(known) = self.decoded.get(&draco.view) {
            return Ok(known.clone());
        }
        let source = self.source;
        let bytes = source.whole_view(mesh, draco.view)?;
        let positions = draco.attributes.get("POSITION");
        let positions = positions.ok_or_else(|| data_error(mesh, "no positions: export the level again"))?;
        let influences = draco.attributes.get("JOINTS_0").zip(draco.attributes.get("WEIGHTS_0"));
        let ids: Vec<u32> =
            [*positions].into_iter().chain(influences.into_iter().flat_map(|(a, b)| [*a, *b])).collect();
        let mut decoded = draco::decode(bytes, &ids, *self.budget).map_err(|it| data_error(mesh, it))?;
        source.spend(decoded.work)?;
        let accessor = primitive.attributes.get("POSITION").and_then(|idx| source.root.accessors.get(*idx));
        if let Some(one) = accessor.and_then(Accessor::one) {
            decoded.attributes[0].as_flattened_mut().iter_mut().for_each(|it| *it = (*it / one).max(-1.0));
        }
        let decoded = Rc::new(decoded);
        self.decoded.insert(draco.view, decoded.clone());
        Ok(decoded)
    }
}

/// A primitive's vertices, and how they form triangles.
struct Surface<'a> {
    vertices: Vertices<'a>,
    /// `None`: the vertices in their order.
    indices: Option<Indices<'a>>,
}

impl Surface<'_> {
    /// The place of the corner `idx` in the level.
    fn corner(&self, mesh: &str, idx: usize, level_from_mesh: DMat4, pose: &Pose) -> Result<DVec3, ImportError> {
        let vertex = self.indices.as_ref().map_or(idx as u32, |indices| indices.at(idx));
        let point = self.vertices.position(vertex as usize).ok_or_else(|| ImportError::VertexOutOfRange {
            mesh: mesh.to_owned(),
            vertex,
            count: self.vertices.count(),
        })?;
        let skinned = pose.joints.as_ref().and_then(|joints| self.vertices.skinned(vertex as usize, point, joints));
        let point = skinned.unwrap_or_else(|| level_from_mesh.transform_point3(point));
        if point.is_finite() { Ok(point) } else { Err(ImportError::NotFinite { node: mesh.to_owned() }) }
    }
}

enum Vertices<'a> {
    Stored {
        positions: Elements<'a>,
        /// Weights of morph targets, and how they shift vertices.
        morphs: Vec<(f32, Elements<'a>)>,
        /// Joints that move vertices, and their weights.
        influences: Vec<(Elements<'a>, Elements<'a>)>,
    },
    /// Positions, and the numbers and weights of joints if there are any.
    Decoded(Rc<DracoMesh>),
}

impl Vertices<'_> {
    fn count(&self) -> usize {
        match self {
            Self::Stored { positions, .. } => positions.count,
            Self::Decoded(mesh) => mesh.attributes[0].len(),
        }
    }

    /// Numbers that are read for each corner, in those of a plain vertex.
    fn parts(&self) -> usize {
        match self {
            Self::Stored { morphs, influences, .. } => 1 + morphs.len() + influences.len(),
            Self::Decoded(_) => 1,
        }
    }

    fn position(&self, idx: usize) -> Option<DVec3> {
        match self {
            Self::Stored { positions, morphs, .. } => {
                let mut point = Vec3::from(positions.floats::<3>(idx)?).as_dvec3();
                for (weight, shifts) in morphs {
                    point += f64::from(*weight) * Vec3::from(shifts.floats::<3>(idx)?).as_dvec3();
                }
                Some(point)
            }
            Self::Decoded(mesh) => mesh.attributes[0].get(idx).map(|[x, y, z, _]| Vec3::new(*x, *y, *z).as_dvec3()),
        }
    }

    /// The place to which joints move the vertex `idx` at `point`; `None` if none moves it.
    fn skinned(&self, idx: usize, point: DVec3, joints: &[DMat4]) -> Option<DVec3> {
        let (mut place, mut total) = (DVec3::ZERO, 0.0);
        let mut add = |numbers: [u32; 4], weights: [f32; 4]| {
            for (joint, weight) in numbers.into_iter().zip(weights).filter(|(_, weight)| *weight > 0.0) {
                if let Some(level_from_bound) = joints.get(joint as usize) {
                    place += f64::from(weight) * level_from_bound.transform_point3(point);
                    total += f64::from(weight);
                }
            }
        };
        match self {
            Self::Stored { influences, .. } => {
                for (numbers, weights) in influences {
                    add(numbers.joints(idx)?, weights.floats(idx)?);
                }
            }
            Self::Decoded(mesh) => {
                let [_, numbers, weights] = mesh.attributes.as_slice() else { return None };
                add(numbers.get(idx)?.map(|number| number as u32), *weights.get(idx)?);
            }
        }
        (total > 0.0).then(|| place / total)
    }
}

enum Indices<'a> {
    Stored(Elements<'a>),
    Decoded(Rc<DracoMesh>),
}

impl Indices<'_> {
    fn count(&self) -> usize {
        match self {
            Self::Stored(indices) => indices.count,
            Self::Decoded(mesh) => mesh.indices.len(),
        }
    }

    fn at(&self, idx: usize) -> u32 {
        match self {
            Self::Stored(indices) => indices.index(idx),
            Self::Decoded(mesh) => mesh.indices[idx],
        }
    }
}
