//! Imports a level made in another tool as a [`Map`].
//!
//! Owns the pipeline: a scene of named nodes (`gltf_in`, `obj_in`), its features (`named`, `sidecar`), its place and
//! size on the map, and the oddities of its geometry (`inspect`).

use crate::faults::{ImportError, Warning};
use crate::file::{FileError, decode};
use crate::found::Found;
use crate::inspect::{self, EdgeCounts};
use crate::load::{check_load, is_allowed};
use crate::named;
use crate::scene::{Frame, ImportOptions, Scene, node_label};
use crate::sidecar::Sidecar;
use crate::sides::{self, Turned};
use crate::{gltf_in, obj_in};
use surefoot_world::map::spec::{MAX_HEIGHT_M, MAX_SIDE_M};
use surefoot_world::map::{Map, MapSize};
use surefoot_world::mesh::{Surface, Triangle};
use surefoot_world::{Aabb, Vec3};

/// Space left around a level, m.
const MARGIN_M: f32 = 2.0;
/// Height of a level's lowest point on the map, m: what falls below 0 has left the map.
const LOWEST_M: f32 = 1.0;
/// Space left above a level, m.
const HEADROOM_M: f32 = 20.0;
/// Excess of a level over a whole metre that counts as a rounding error, m.
const ROUNDING_M: f32 = 0.001;
/// Largest distance by which an exported map's triangles may stick out of its box if the map is to keep its size, m.
const STICK_OUT_M: f32 = 5.0;

/// Side of a level that is hardly one in metres, and a side that would be, m.
const TINY_M: f32 = 4.0;
const SMALL_M: f32 = 10.0;

/// A level as a map.
#[derive(Debug)]
pub struct Imported {
    /// The map of the level.
    pub map: Map,
    /// Where the level's origin lies on the map, m.
    pub origin: Vec3,
    /// Oddities that a designer may want to correct.
    pub warnings: Vec<Warning>,
}

/// Imports a level from glTF 2.0: a `.glb`, or a `.gltf` with embedded buffers. `sidecar` is the content of its
/// `.surefoot.json`, which lists features in the level's own coordinates.
///
/// # Errors
/// If the file is damaged, uses unsupported features, or does not describe a map; the error says what to change.
pub fn import_gltf(bytes: &[u8], sidecar: Option<&str>, options: &ImportOptions) -> Result<Imported, ImportError> {
    import(gltf_in::read(bytes)?, sidecar, options)
}

/// Imports a level from Wavefront OBJ; each object or group is a node. Materials are ignored, and faces with more
/// than four corners must be convex.
///
/// # Errors
/// Same as [`import_gltf`].
pub fn import_obj(bytes: &[u8], sidecar: Option<&str>, options: &ImportOptions) -> Result<Imported, ImportError> {
    import(obj_in::read(bytes)?, sidecar, options)
}

/// Why bytes are no level.
#[derive(Debug, thiserror::Error)]
pub enum LevelError {
    /// They begin like a saved map.
    #[error(transparent)]
    Saved(#[from] FileError),
    /// They are those of a model.
    #[error(transparent)]
    Model(#[from] ImportError),
}

/// Reads a level of any format that its first bytes tell: a saved map, a glTF, or else an OBJ. `sidecar` is as in
/// [`import_gltf`]; saved maps need none.
///
/// # Errors
/// As [`decode`], [`import_gltf`] or [`import_obj`].
pub fn read_level(bytes: &[u8], sidecar: Option<&str>) -> Result<Imported, LevelError> {
    let options = ImportOptions::default();
    let is_text_gltf = bytes.iter().find(|byte| !byte.is_ascii_whitespace()) == Some(&b'{');
    if bytes.starts_with(b"SFMAP") {
        Ok(Imported { map: decode(bytes)?, origin: Vec3::ZERO, warnings: Vec::new() })
    } else if bytes.starts_with(b"glTF") || is_text_gltf {
        Ok(import_gltf(bytes, sidecar, &options)?)
    } else {
        Ok(import_obj(bytes, sidecar, &options)?)
    }
}

fn import(mut scene: Scene, sidecar: Option<&str>, options: &ImportOptions) -> Result<Imported, ImportError> {
    let frame = Frame::new(options)?;
    convert(&mut scene, frame)?;
    let mut found = Found::default();
    let sidecar = sidecar.map_or_else(|| Ok(Sidecar::default()), Sidecar::parse)?;
    let is_solid = named::collect_from_nodes(&scene.nodes, &sidecar, frame, &mut found)?;
    sidecar.collect(frame, &mut found)?;
    let mut meshes: Vec<&mut Vec<[Vec3; 3]>> =
        scene.nodes.iter_mut().zip(is_solid).filter(|(_, solid)| *solid).map(|(node, _)| &mut node.triangles).collect();
    let former = scene.former_size.filter(|_| *options == ImportOptions::default());
    let modelled = edges(&meshes);
    // What was exported from a map is as it should be.
    let is_right = scene.former_size.is_some() || options.keep_sides;
    let (turned, open) = if is_right { Default::default() } else { sides::turn(&mut meshes) };
    let solids: Vec<[Vec3; 3]> = meshes.iter().flat_map(|triangles| triangles.iter()).copied().collect();
    let place = Place::new(&solids, &found, former)?;
    let moved = |corners: &[Vec3; 3]| Triangle::new(corners.map(|corner| corner + place.shift), Surface::Ground);
    let triangles: Vec<Triangle> = solids.iter().filter_map(moved).collect();
    if triangles.is_empty() {
        return Err(ImportError::Empty);
    }

    let mut warnings = Vec::from_iter(tiny(place.high - place.low));
    warnings.extend(geometry_warnings(scene.skipped_count, modelled, turned, solids.len() - triangles.len()));
    if found.helper_count > 0 {
        warnings.push(Warning::Helpers { count: found.helper_count });
    }
    let flat_count = found.flat_pool_count();
    if flat_count > 0 {
        warnings.push(Warning::FlatPools { count: flat_count });
    }
    warnings.extend(former.filter(|_| !place.is_former).map(|former| Warning::Outgrown { former }));

    let outside = |what: String| {
        let (one, other) = (frame.to_level(place.low), frame.to_level(place.high));
        ImportError::Outside { what, low: one.min(other), high: one.max(other) }
    };
    let movers = found.take_movers(place.shift);
    let placed = found.place(place.shift, place.size).map_err(outside)?;
    check_load(place.size, &triangles, &placed)?;
    let spare = (!open.is_empty()).then(|| (triangles.clone(), placed.clone()));
    let mut map = Map::from_parts(place.size, triangles, placed);
    if let Some((mut triangles, placed)) = spare {
        let backs = open.iter().filter_map(|surface| surface.backs(place.shift, map.mesh()));
        let plates: Vec<Triangle> =
            backs.flat_map(|backs| backs.iter().filter_map(moved).collect::<Vec<_>>()).collect();
        if !plates.is_empty() {
            warnings.push(Warning::Plates { count: plates.len() });
            triangles.extend(plates);
            check_load(place.size, &triangles, &placed)?;
            map = Map::from_parts(place.size, triangles, placed);
        }
    }
    Ok(Imported { map: map.with_movers(movers)?, origin: place.shift, warnings })
}

/// The irregular edges of a level as it was modelled.
fn edges(meshes: &[&mut Vec<[Vec3; 3]>]) -> EdgeCounts {
    let triangles = meshes.iter().flat_map(|triangles| triangles.iter());
    let has_area = |corners: &[Vec3; 3]| Triangle::new(*corners, Surface::Ground).is_some();
    inspect::edges(&triangles.copied().filter(has_area).collect::<Vec<_>>())
}

fn geometry_warnings(skipped_count: usize, edges: EdgeCounts, turned: Turned, degenerate_count: usize) -> Vec<Warning> {
    // Turned triangles make edges consistent.
    let inconsistent_count = if turned.triangles == 0 { edges.turned } else { 0 };
    let counted = [
        (degenerate_count, Warning::DegenerateTriangles { count: degenerate_count }),
        (skipped_count, Warning::NotTriangles { count: skipped_count }),
        (turned.shells, Warning::TurnedShells { count: turned.shells }),
        (turned.triangles, Warning::TurnedTriangles { count: turned.triangles }),
        (edges.open, Warning::OpenEdges { count: edges.open }),
        (edges.crowded, Warning::NonManifoldEdges { count: edges.crowded }),
        (inconsistent_count, Warning::InconsistentEdges { count: inconsistent_count }),
    ];
    counted.into_iter().filter(|(count, _)| *count > 0).map(|(_, warning)| warning).collect()
}

/// The warning about a level that no character would fit into, which asks whether its unit is another.
fn tiny(span: Vec3) -> Option<Warning> {
    let side = span.x.max(span.z);
    let times = [10.0, 100.0, 1000.0].into_iter().find(|times| side * times >= SMALL_M)?;
    (side < TINY_M).then_some(Warning::Tiny { span, times })
}

/// Converts all coordinates to metres, y up.
fn convert(scene: &mut Scene, frame: Frame) -> Result<(), ImportError> {
    for (idx, node) in scene.nodes.iter_mut().enumerate() {
        node.origin = frame.to_metres(node.origin);
        let mut is_finite = node.origin.is_finite();
        for corner in node.triangles.iter_mut().flatten() {
            *corner = frame.to_metres(*corner);
            is_finite &= corner.is_finite();
        }
        if !is_finite {
            return Err(ImportError::NotFinite { node: node_label(&node.name, idx) });
        }
    }
    Ok(())
}

/// Position of a level on its map.
struct Place {
    /// Translation from the level's coordinates, m, to the map's.
    shift: Vec3,
    size: MapSize,
    /// Bounds of the level before the shift, m.
    low: Vec3,
    high: Vec3,
    /// Whether the level keeps the position that it was exported from.
    is_former: bool,
}

impl Place {
    fn new(solids: &[[Vec3; 3]], found: &Found, former: Option<MapSize>) -> Result<Self, ImportError> {
        let bounds = Aabb::around(solids.iter().flatten().copied()).ok_or(ImportError::Empty)?;
        let Aabb { mut low, mut high } = bounds;
        if let Some(size) = former.filter(|&size| is_allowed(size)) {
            let extent = size.extent();
            let slack = Vec3::splat(STICK_OUT_M);
            if low.cmpge(-slack).all() && high.cmple(extent + slack).all() {
                return Ok(Self { shift: Vec3::ZERO, size, low: Vec3::ZERO, high: extent, is_former: true });
            }
        }
        // The bottom of a pool may be the lowest point of the level.
        let (pool_low, pool_high) = found.pool_heights();
        (low.y, high.y) = (low.y.min(pool_low), high.y.max(pool_high));
        let span = high - low;
        let (most_wide, most_high) = (MAX_SIDE_M as f32, MAX_HEIGHT_M as f32);
        if span.x > most_wide || span.y + LOWEST_M > most_high || span.z > most_wide {
            return Err(ImportError::TooLarge(span));
        }
        // The largest levels get smaller margins.
        let margin = |span: f32| (0.5 * (most_wide - span)).min(MARGIN_M);
        let (margin_x, margin_z) = (margin(span.x), margin(span.z));
        let whole = |metres: f32, most: f32| (metres - ROUNDING_M).ceil().clamp(1.0, most) as u32;
        let size = MapSize {
            width: whole(span.x + 2.0 * margin_x, most_wide),
            height: whole(LOWEST_M + span.y + HEADROOM_M, most_high),
            depth: whole(span.z + 2.0 * margin_z, most_wide),
        };
        let shift = Vec3::new(margin_x, LOWEST_M, margin_z) - low;
        Ok(Self { shift, size, low, high, is_former: false })
    }
}
