//! Reads glTF 2.0 into a scene: nodes with their transforms applied.
//!
//! The JSON is parsed into the types of the `gltf` crate, but without its wrappers: those trust indices and lengths,
//! and the crate's own validation indexes with a number from the file. Here every index, offset and length is checked
//! on use.

use crate::animated::Animation;
use crate::faults::{ImportError, MAX_TRIANGLES};
use crate::meshopt::{self, Compression};
use crate::scene::{Node, Scene, node_label};
use base64::Engine;
use base64::alphabet::STANDARD;
use base64::engine::general_purpose::{GeneralPurpose, NO_PAD};
use glam::{Mat4, Quat};
use gltf::json::accessor::{ComponentType, Type};
use gltf::json::animation::{Interpolation, Property};
use gltf::json::mesh::{Mode, Primitive, Semantic};
use gltf::json::validation::Checked;
use gltf::json::{self, Index, Root};
use serde::Deserialize;
use std::borrow::Cow;
use std::cell::{Cell, OnceCell};
use surefoot_world::Vec3;
use surefoot_world::map::MapSize;

/// Extension that repeats a mesh, without a fallback for programs that do not support it.
const INSTANCING_EXTENSION: &str = "EXT_mesh_gpu_instancing";
/// Extension that allows positions of other types than 32-bit floats.
const QUANTIZATION_EXTENSION: &str = "KHR_mesh_quantization";
/// Prefixes of extensions that only change the appearance, so that a level may require them.
const APPEARANCE_EXTENSIONS: [&str; 5] =
    ["KHR_materials_", "KHR_texture_", "KHR_lights_", "EXT_texture_", "EXT_lights_"];
/// Most bytes of compressed views that are decoded for a level: those of three million triangles, several times over.
const MAX_DECODED_BYTES: usize = 256 << 20;
const DATA_URI: &str = "data:";
const BASE64_MARK: &str = ";base64,";
/// Base64 with the standard alphabet (RFC 4648, section 4). Padding is cut off before; leftover bits are ignored.
const BASE64: GeneralPurpose = GeneralPurpose::new(&STANDARD, NO_PAD.with_decode_allow_trailing_bits(true));

pub(super) fn read(bytes: &[u8]) -> Result<Scene, ImportError> {
    let (json, binary) = if bytes.starts_with(b"glTF") { split_glb(bytes)? } else { (bytes, None) };
    let root = Root::from_slice(json).map_err(|error| ImportError::Json(error.to_string()))?;
    if !root.asset.version.starts_with("2.") {
        return Err(ImportError::GltfVersion(root.asset.version.clone()));
    }
    check_extensions(&root)?;
    let buffers = root.buffers.iter().enumerate().map(|(idx, buffer)| read_buffer(idx, buffer, binary));
    let buffers = buffers.collect::<Result<Vec<_>, _>>()?;
    let decoded = root.buffer_views.iter().map(|_| OnceCell::new()).collect();
    let source = Source { root: &root, buffers, decoded, decoding_budget: Cell::new(MAX_DECODED_BYTES) };
    Reader { source: &source, triangle_budget: MAX_TRIANGLES, skipped_count: 0 }.scene()
}

/// Splits a `.glb` into its JSON chunk and its binary chunk.
fn split_glb(bytes: &[u8]) -> Result<(&[u8], Option<&[u8]>), ImportError> {
    let header: &[u8; 12] = bytes.first_chunk().ok_or(ImportError::Container("its header is cut off"))?;
    let number = |at: usize| u32::from_le_bytes([header[at], header[at + 1], header[at + 2], header[at + 3]]);
    if number(4) != 2 {
        return Err(ImportError::GltfVersion(number(4).to_string()));
    }
    let contents = bytes.get(12..number(8) as usize).ok_or(ImportError::Container("it is cut off"))?;
    let json = Chunk::first(contents)?;
    if json.kind != b"JSON" {
        return Err(ImportError::Container("it does not begin with JSON"));
    }
    if json.rest.is_empty() {
        return Ok((json.content, None));
    }
    let binary = Chunk::first(json.rest)?;
    Ok((json.content, (binary.kind == b"BIN\0").then_some(binary.content)))
}

/// A chunk of a `.glb`, and the bytes that follow it.
struct Chunk<'a> {
    kind: &'a [u8; 4],
    content: &'a [u8],
    rest: &'a [u8],
}

impl<'a> Chunk<'a> {
    fn first(bytes: &'a [u8]) -> Result<Self, ImportError> {
        let chunk = bytes.split_first_chunk::<4>().and_then(|(len, rest)| {
            let (kind, rest) = rest.split_first_chunk::<4>()?;
            let (content, rest) = rest.split_at_checked(u32::from_le_bytes(*len) as usize)?;
            Some(Self { kind, content, rest })
        });
        chunk.ok_or(ImportError::Container("one of its chunks is cut off"))
    }
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

fn read_buffer<'a>(idx: usize, buffer: &json::Buffer, binary: Option<&'a [u8]>) -> Result<Cow<'a, [u8]>, ImportError> {
    let bytes = match (&buffer.uri, binary) {
        (None, Some(binary)) if idx == 0 => Cow::Borrowed(binary),
        // A fallback buffer has no data, which is an error only if something reads it.
        (None, _) => return Ok(Cow::Borrowed(&[])),
        (Some(uri), _) if uri.starts_with(DATA_URI) => {
            let text = uri.split_once(BASE64_MARK).map(|(_, text)| text.trim_end_matches('='));
            Cow::Owned(text.and_then(|text| BASE64.decode(text).ok()).ok_or(ImportError::Base64 { buffer: idx })?)
        }
        (Some(uri), _) => return Err(ImportError::ExternalBuffer { uri: uri.chars().take(200).collect() }),
    };
    let (len, expected) = (bytes.len(), buffer.byte_length.0);
    if (len as u64) < expected { Err(ImportError::ShortBuffer { buffer: idx, len, expected }) } else { Ok(bytes) }
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

struct Source<'a> {
    root: &'a Root,
    buffers: Vec<Cow<'a, [u8]>>,
    /// Decoded content of compressed views, filled on the first read.
    decoded: Vec<OnceCell<Vec<u8>>>,
    /// Bytes that may still be decoded.
    decoding_budget: Cell<usize>,
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
                let json = self.source.root.nodes.get(target);
                let (Some((own_idx, level_from_parent)), Some(json)) = (placed.get(target).copied().flatten(), json)
                else {
                    continue;
                };
                if !is_shown[own_idx] {
                    continue;
                }
                let from = format!("the animation of {}", label(nodes, own_idx));
                let sampler = channel.sampler.value();
                let reference = || ImportError::Reference { from: from.clone(), to: "sampler", idx: sampler };
                let sampler = animation.samplers.get(sampler).ok_or_else(reference)?;
                let width = match channel.target.path {
                    Checked::Valid(Property::Translation) => 3,
                    Checked::Valid(Property::Rotation) => 4,
                    _ => continue,
                };
                let is_spline = sampler.interpolation == Checked::Valid(Interpolation::CubicSpline);
                let keys = self.keys(&from, sampler, width, is_spline)?;
                let rest = parent_from_node(json);
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
            }
        }
        let is_finite = |animation: &Animation| {
            animation.shifts.iter().all(|(at, shift)| at.is_finite() && shift.is_finite())
                && animation.turns.iter().all(|(at, turn)| at.is_finite() && turn.is_finite())
        };
        let broken = nodes.iter().position(|node| node.animation.as_ref().is_some_and(|it| !is_finite(it)));
        broken.map_or(Ok(()), |idx| Err(ImportError::NotFinite { node: label(nodes, idx) }))
    }

    /// The times of a sampler, s, and the values of `width` numbers at them.
    fn keys(
        &mut self,
        from: &str,
        sampler: &json::animation::Sampler,
        width: usize,
        is_spline: bool,
    ) -> Result<Vec<(f32, [f32; 4])>, ImportError> {
        let times = self.source.elements(from, sampler.input.value(), Layout::Floats(1))?;
        let values = self.source.elements(from, sampler.output.value(), Layout::Floats(width))?;
        // Keys are bounded like triangles: an accessor may be read again and again.
        self.triangle_budget = self.triangle_budget.checked_sub(times.count).ok_or(ImportError::TooManyTriangles)?;
        // A spline has a tangent before and after each value.
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

impl Source<'_> {
    /// The elements of an accessor, checked to lie within its view and buffer.
    fn elements(&self, mesh: &str, accessor_idx: usize, layout: Layout) -> Result<Elements<'_>, ImportError> {
        let reference = |to, idx| ImportError::Reference { from: mesh.to_owned(), to, idx };
        let accessor = self.root.accessors.get(accessor_idx).ok_or_else(|| reference("accessor", accessor_idx))?;
        if accessor.sparse.is_some() {
            return Err(data_error(mesh, "sparse accessors, which are not supported: export it without them"));
        }
        let mut encoding = Encoding { component: ComponentType::U32, is_normalized: accessor.normalized };
        let width = match (layout, accessor.type_, accessor.component_type) {
            (Layout::Positions, Checked::Valid(Type::Vec3), Checked::Valid(component))
                if component.0 != ComponentType::U32 =>
            {
                encoding.component = component.0;
                3 * component.0.size()
            }
            (Layout::Floats(width), Checked::Valid(kind), Checked::Valid(component))
                if kind.multiplicity() == width && component.0 != ComponentType::U32 =>
            {
                encoding.component = component.0;
                width * component.0.size()
            }
            (Layout::Floats(_), ..) => {
                return Err(data_error(mesh, "keys that are no numbers of its kind: export the level again"));
            }
            (Layout::Indices, Checked::Valid(Type::Scalar), Checked::Valid(component)) => match component.0 {
                ComponentType::U8 => 1,
                ComponentType::U16 => 2,
                ComponentType::U32 => 4,
                _ => return Err(data_error(mesh, "indices that are not unsigned integers: export it again")),
            },
            (Layout::Positions, ..) => {
                return Err(data_error(mesh, "positions that are neither floats nor quantized: export it again"));
            }
            (Layout::Indices, ..) => {
                return Err(data_error(mesh, "indices that are not unsigned integers: export it again"));
            }
        };
        let no_data = || data_error(mesh, "no vertex data: export it without compression");
        let view_idx = accessor.buffer_view.ok_or_else(no_data)?.value();
        let view = self.root.buffer_views.get(view_idx).ok_or_else(|| reference("buffer view", view_idx))?;
        let stride = view.byte_stride.map_or(width, |stride| stride.0);
        let count = accessor.count.0;
        let bytes = self.view(mesh, view_idx, view)?.and_then(|view| {
            let len = match count.checked_sub(1) {
                Some(gaps) => gaps.checked_mul(stride as u64)?.checked_add(width as u64)?,
                None => 0,
            };
            view.get(range(accessor.byte_offset.map_or(0, |offset| offset.0), len)?)
        });
        let too_short = || data_error(mesh, "data that lies outside its buffer: the file is damaged; export it again");
        let bytes = bytes.filter(|_| stride >= width).ok_or_else(too_short)?;
        // The bytes exist, so the count fits into a usize.
        Ok(Elements { bytes, stride, width, count: count as usize, encoding })
    }

    /// The bytes of a view; `None` if they lie outside its buffer.
    fn view(&self, mesh: &str, view_idx: usize, view: &json::buffer::View) -> Result<Option<&[u8]>, ImportError> {
        let part = |buffer_idx: usize, offset: u64, len: u64| {
            let reference = || ImportError::Reference { from: mesh.to_owned(), to: "buffer", idx: buffer_idx };
            let buffer = self.buffers.get(buffer_idx).ok_or_else(reference)?;
            Ok(range(offset, len).and_then(|range| buffer.get(range)))
        };
        let failed = |problem| data_error(mesh, problem);
        let Some(compression) = Compression::of(view).map_err(failed)? else {
            return part(view.buffer.value(), view.byte_offset.map_or(0, |offset| offset.0), view.byte_length.0);
        };
        let decoded = &self.decoded[view_idx];
        if let Some(known) = decoded.get() {
            return Ok(Some(known));
        }
        let Some(bytes) = part(compression.buffer, compression.byte_offset, compression.byte_length)? else {
            return Ok(None);
        };
        let left = self.decoding_budget.get().checked_sub(compression.decoded_len());
        self.decoding_budget.set(left.ok_or(ImportError::TooManyTriangles)?);
        let content = compression.decode(bytes).map_err(failed)?;
        Ok(Some(decoded.get_or_init(|| content)))
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

fn data_error(mesh: &str, problem: &'static str) -> ImportError {
    ImportError::Data { mesh: mesh.to_owned(), problem }
}

fn range(offset: u64, len: u64) -> Option<std::ops::Range<usize>> {
    let end = offset.checked_add(len)?;
    Some(usize::try_from(offset).ok()?..usize::try_from(end).ok()?)
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

/// Kind of data that an accessor is read as.
#[derive(Debug, Clone, Copy)]
enum Layout {
    Positions,
    Indices,
    /// This many numbers each.
    Floats(usize),
}

/// Checked elements: `count` elements of `width` bytes, `stride` bytes apart; the last one is complete.
struct Elements<'a> {
    bytes: &'a [u8],
    stride: usize,
    width: usize,
    count: usize,
    encoding: Encoding,
}

/// How the components of a position are stored.
#[derive(Debug, Clone, Copy)]
struct Encoding {
    component: ComponentType,
    is_normalized: bool,
}

impl Encoding {
    /// A component in little-endian `bytes` of its size.
    fn decode(self, bytes: &[u8]) -> Option<f32> {
        let (value, most) = match self.component {
            ComponentType::I8 => (f32::from(*bytes.first()? as i8), f32::from(i8::MAX)),
            ComponentType::U8 => (f32::from(*bytes.first()?), f32::from(u8::MAX)),
            ComponentType::I16 => (f32::from(i16::from_le_bytes(*bytes.first_chunk()?)), f32::from(i16::MAX)),
            ComponentType::U16 => (f32::from(u16::from_le_bytes(*bytes.first_chunk()?)), f32::from(u16::MAX)),
            ComponentType::F32 => return Some(f32::from_le_bytes(*bytes.first_chunk()?)),
            ComponentType::U32 => return None,
        };
        // glTF 2.0, section 3.6.2.2: the most negative number stands for -1 as well.
        Some(if self.is_normalized { (value / most).max(-1.0) } else { value })
    }
}

impl Elements<'_> {
    fn element(&self, idx: usize) -> Option<&[u8]> {
        (idx < self.count).then(|| &self.bytes[idx * self.stride..idx * self.stride + self.width])
    }

    fn position(&self, idx: usize) -> Option<Vec3> {
        let mut components = self.element(idx)?.chunks_exact(self.width / 3);
        let mut next = || self.encoding.decode(components.next()?);
        Some(Vec3::new(next()?, next()?, next()?))
    }

    /// The first `width` numbers at `idx`, at most 4, followed by zeros.
    fn floats(&self, idx: usize, width: usize) -> Option<[f32; 4]> {
        let mut components = self.element(idx)?.chunks_exact(self.width / width);
        let mut values = [0.0; 4];
        for value in &mut values[..width] {
            *value = self.encoding.decode(components.next()?)?;
        }
        Some(values)
    }

    /// The vertex index at `idx`, which must be below `count`.
    fn index(&self, idx: usize) -> u32 {
        let bytes = self.element(idx).unwrap_or_default();
        bytes.iter().rev().fold(0, |value, &byte| value << 8 | u32::from(byte))
    }
}
