//! Imports a level made in another tool as a [`Map`].
//!
//! Owns the pipeline: a scene of named nodes (`gltf_in`, `obj_in`); what the nodes stand for (`named`, `sidecar`) and
//! what does not belong (`belongs`); features (`found`); sides (`sides`); the place on the map (`place`).

use crate::belongs::{self, Finding};
use crate::container::Files;
use crate::faults::{ImportError, Warning};
use crate::file::{FileError, decode};
use crate::found::Found;
use crate::inspect::{self, EdgeCounts};
use crate::load::check_load;
use crate::meaning::Meaning;
use crate::moving::Paths;
use crate::named;
use crate::place::Place;
use crate::report::{GeometryCounts, NodeReport, Role};
use crate::scene::{ImportOptions, Node, Scene, node_label};
use crate::sidecar::Sidecar;
use crate::sides;
use crate::units::{self, Suggestion};
use crate::zip::{Zip, is_zip};
use crate::{gltf_in, obj_in};
use glam::DVec3;
use surefoot_world::map::{LevelFrame, Map};
use surefoot_world::mesh::{Surface, Triangle};
use surefoot_world::{Aabb, Vec3};

/// Distance from its origin up to which a level is read in its own coordinates, m; their 32 bits are 0.06 mm apart
/// there. Levels that are farther away are read relative to a point among them.
const NEAR_M: f64 = 1000.0;
/// Triangles from which that point is chosen, at most.
const SAMPLES: usize = 4096;

/// A level as a map.
#[derive(Debug)]
pub struct Imported {
    /// The map of the level; its frame tells how the level's coordinates relate to the map's.
    pub map: Map,
    /// What a designer may want to change.
    pub warnings: Vec<Warning>,
    /// What became of each node, in the order of the file.
    pub nodes: Vec<NodeReport>,
    /// Counts that describe the geometry.
    pub geometry: GeometryCounts,
}

impl Imported {
    /// A saved map, of which no nodes are known.
    pub fn saved(map: Map) -> Self {
        Self { map, warnings: Vec::new(), nodes: Vec::new(), geometry: GeometryCounts::default() }
    }
}

/// Imports a level from glTF 2.0: a `.glb` or a `.gltf`. `sidecar` is the content of its `.surefoot.json`, which lists
/// features in the level's own coordinates; `files` has what a `.gltf` refers to.
///
/// # Errors
/// If the file is damaged, uses unsupported features, or does not describe a map; the error says what to change.
pub fn import_gltf(
    bytes: &[u8],
    sidecar: Option<&str>,
    options: &ImportOptions,
    files: &dyn Files,
) -> Result<Imported, ImportError> {
    import(gltf_in::read(bytes, options, files)?, sidecar, options)
}

/// Imports a level from Wavefront OBJ; each object or group is a node. Materials are ignored.
///
/// # Errors
/// Same as [`import_gltf`].
pub fn import_obj(bytes: &[u8], sidecar: Option<&str>, options: &ImportOptions) -> Result<Imported, ImportError> {
    import(obj_in::read(bytes)?, sidecar, options)
}

/// Imports a level from a `.zip` of a glTF or an OBJ and the files that it refers to. A sidecar in it counts if there
/// is no other.
///
/// # Errors
/// Same as [`import_gltf`], or if the archive cannot be read or does not hold one level.
pub fn import_zip(bytes: &[u8], sidecar: Option<&str>, options: &ImportOptions) -> Result<Imported, ImportError> {
    let zip = Zip::open(bytes)?;
    let level = zip.level()?;
    let sidecar = match sidecar {
        Some(sidecar) => Some(sidecar.to_owned()),
        None => zip.sidecar()?,
    };
    import(scene(&level, options, &zip)?, sidecar.as_deref(), options)
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

/// Reads a level of any format that its first bytes tell: a saved map, a `.zip` of a level and its files, a glTF, or
/// else an OBJ. `sidecar` and `files` are as in [`import_gltf`]; saved maps need none, and a `.zip` has its own files.
///
/// # Errors
/// As [`decode`], [`import_gltf`] or [`import_obj`].
pub fn read_level(
    bytes: &[u8],
    sidecar: Option<&str>,
    options: &ImportOptions,
    files: &dyn Files,
) -> Result<Imported, LevelError> {
    if bytes.starts_with(b"SFMAP") {
        return Ok(Imported::saved(decode(bytes)?));
    }
    if is_zip(bytes) {
        return Ok(import_zip(bytes, sidecar, options)?);
    }
    Ok(import(scene(bytes, options, files)?, sidecar, options)?)
}

/// Reads a glTF or an OBJ.
fn scene(bytes: &[u8], options: &ImportOptions, files: &dyn Files) -> Result<Scene, ImportError> {
    let text = bytes.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(bytes);
    let is_json = text.iter().find(|byte| !byte.is_ascii_whitespace()) == Some(&b'{');
    let is_gltf = is_json || bytes.starts_with(b"glTF");
    if is_gltf { gltf_in::read(bytes, options, files) } else { obj_in::read(bytes) }
}

fn import(scene: Scene, sidecar: Option<&str>, options: &ImportOptions) -> Result<Imported, ImportError> {
    let sidecar = sidecar.map_or_else(|| Ok(Sidecar::default()), Sidecar::parse)?;
    let former = scene.former_size.filter(|_| options.is_unchanged());
    let is_exported = scene.former_size.is_some();
    let (mut scene, mut frame) = near(scene, options)?;
    let mut warnings = Vec::new();
    let paths = Paths::of(&scene, frame);
    let ignore_names = options.ignore_names || sidecar.ignores_names();
    let mut meanings = named::meanings(&scene, &sidecar, ignore_names, &paths, &mut warnings)?;
    let mut owners = named::owners(&scene, &mut meanings, &mut warnings);
    if !sidecar.colliders.is_empty() {
        keep_colliders(&scene, &mut meanings, &mut owners);
    }
    let mut report = report(&scene, &meanings, &owners, &frame);
    if !is_exported {
        let is_judged = judged(&scene, &owners, &meanings);
        let findings = belongs::judge(&scene, &is_judged, ignore_names);
        leave_out(&mut scene, &findings, &mut report, &mut warnings);
    }
    let mut nodes: Vec<Node> = scene.into_iter().map(|node| node.map(|point| point.as_vec3())).collect();
    let mut found = Found::default();
    found.add_nodes(&nodes, &meanings, &owners, &paths)?;
    sidecar.collect(&frame, &mut found)?;
    let is_solid: Vec<bool> = owners.iter().map(Option::is_none).collect();
    let mut geometry = GeometryCounts {
        points_and_lines: nodes.iter().map(|node| node.skipped_count).sum(),
        ..GeometryCounts::default()
    };
    let mut meshes: Vec<&mut Vec<[Vec3; 3]>> =
        nodes.iter_mut().zip(&is_solid).filter(|(_, solid)| **solid).map(|(node, _)| &mut node.triangles).collect();
    let EdgeCounts { open, crowded, turned } = edges(&meshes);
    (geometry.open_edges, geometry.crowded_edges, geometry.inconsistent_edges) = (open, crowded, turned);
    // What was exported from a map is as it should be.
    let (turned, open) = if is_exported || options.keep_sides { Default::default() } else { sides::turn(&mut meshes) };
    (geometry.turned_shells, geometry.turned_triangles) = (turned.shells, turned.triangles);
    let solids: Vec<[Vec3; 3]> = meshes.iter().flat_map(|triangles| triangles.iter()).copied().collect();
    let bounds = bounds(&solids, &found)?;
    let unit = if is_exported { None } else { other_unit(&solids, &nodes, options.scale) };
    let place = Place::new(bounds, former).map_err(|span| too_large(span, &nodes, &is_solid, unit.clone()))?;
    frame.origin += place.shift.as_dvec3();
    let moved_as = |surface: Surface| {
        move |corners: &[Vec3; 3]| Triangle::new(corners.map(|corner| corner + place.shift), surface)
    };
    let moved = moved_as(Surface::Ground);
    let mut triangles: Vec<Triangle> = solids.iter().filter_map(moved).collect();
    if triangles.is_empty() {
        return Err(ImportError::Empty);
    }
    (geometry.triangles, geometry.degenerate) = (triangles.len(), solids.len() - triangles.len());
    triangles.extend(found.climbs.iter().filter_map(moved_as(Surface::Climb)));
    // Turned triangles make edges consistent.
    let inconsistent = if turned.triangles == 0 { geometry.inconsistent_edges } else { 0 };
    warnings.extend((inconsistent > 0).then_some(Warning::InconsistentEdges { count: inconsistent }));
    warnings.extend(unit);
    let flat_count = found.flat_pool_count();
    warnings.extend((flat_count > 0).then_some(Warning::FlatPools { count: flat_count }));
    warnings.extend(former.filter(|_| !place.is_former).map(|former| Warning::Outgrown { former }));

    let outside = |what: String| {
        let (one, other) = (frame.to_level(place.low + place.shift), frame.to_level(place.high + place.shift));
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
            geometry.plates = plates.len();
            triangles.extend(plates);
            check_load(place.size, &triangles, &placed)?;
            map = Map::from_parts(place.size, triangles, placed);
        }
    }
    Ok(Imported { map: map.with_movers(movers)?.with_frame(frame), warnings, nodes: report, geometry })
}

/// Converts a scene to metres, y up, near the origin, and returns the frame in which it is then.
fn near(scene: Scene, options: &ImportOptions) -> Result<(Vec<Node<DVec3>>, LevelFrame), ImportError> {
    if !(options.scale > 0.0 && options.scale.is_finite()) {
        return Err(ImportError::Scale(options.scale));
    }
    let mut frame = LevelFrame { origin: DVec3::ZERO, scale: options.scale, up: options.up };
    let middle = frame.to_metres(middle(&scene.nodes));
    if middle.abs().max_element() > NEAR_M {
        frame.origin = -middle.round();
    }
    let converted = |node: Node<DVec3>| {
        let label = node_label(&node.name, node.file_idx);
        let node = node.map(|point| frame.to_metres(point) + frame.origin);
        let is_finite = |point: &DVec3| point.as_vec3().is_finite();
        let is_finite = node.triangles.iter().flatten().chain([&node.origin]).all(is_finite);
        if is_finite { Ok(node) } else { Err(ImportError::NotFinite { node: label }) }
    };
    let nodes = scene.nodes.into_iter().map(converted).collect::<Result<_, _>>()?;
    Ok((nodes, frame))
}

/// The median of some triangles' corners, along each axis: few triangles far away do not matter.
fn middle(nodes: &[Node<DVec3>]) -> DVec3 {
    let count: usize = nodes.iter().map(|node| node.triangles.len()).sum();
    let step = count.div_ceil(SAMPLES).max(1);
    let mut corners: Vec<DVec3> =
        nodes.iter().flat_map(|node| &node.triangles).step_by(step).map(|corners| corners[0]).collect();
    let mut median = DVec3::ZERO;
    for axis in 0..3 {
        let half = corners.len() / 2;
        if half < corners.len() {
            median[axis] = corners.select_nth_unstable_by(half, |one, other| one[axis].total_cmp(&other[axis])).1[axis];
        }
    }
    median
}

/// Leaves all out but what the sidecar declares a collider, and what is below that.
fn keep_colliders(nodes: &[Node<DVec3>], meanings: &mut [Meaning], owners: &mut [Option<usize>]) {
    let mut is_collider: Vec<bool> = Vec::with_capacity(nodes.len());
    for (idx, node) in nodes.iter().enumerate() {
        let is_inside = node.parent.is_some_and(|parent| is_collider[parent]);
        is_collider.push(meanings[idx].is_declared_solid || is_inside);
        if owners[idx].is_none() && !is_collider[idx] && !node.triangles.is_empty() {
            owners[idx] = Some(idx);
            meanings[idx] = Meaning::left_out("it is none of the sidecar's `colliders`");
        }
    }
}

/// The nodes that may turn out to be no part of the level: those that are solid and that no designer declared solid,
/// nor a node above them.
fn judged(nodes: &[Node<DVec3>], owners: &[Option<usize>], meanings: &[Meaning]) -> Vec<bool> {
    let mut is_declared: Vec<bool> = Vec::with_capacity(nodes.len());
    for (node, meaning) in nodes.iter().zip(meanings) {
        let is_inside = node.parent.is_some_and(|parent| is_declared[parent]);
        is_declared.push(meaning.is_declared_solid || is_inside);
    }
    owners.iter().zip(is_declared).map(|(owner, is_declared)| owner.is_none() && !is_declared).collect()
}

/// Leaves out what does not belong to a level, and notes it.
fn leave_out(nodes: &mut [Node<DVec3>], findings: &[Finding], report: &mut [NodeReport], warnings: &mut Vec<Warning>) {
    for finding in findings {
        // Many exporters put the mesh into a node without a name below that with the name.
        let line = std::iter::successors(Some(&nodes[finding.node]), |node| node.parent.map(|above| &nodes[above]));
        let own = &nodes[finding.node];
        let named = line.take(3).find(|node| !node.name.is_empty()).unwrap_or(own);
        report[finding.node].reason = finding.reason();
        warnings.push(Warning::LeftOut { text: finding.text(&node_label(&named.name, named.file_idx)) });
    }
    belongs::apply(nodes, findings);
    for finding in findings.iter().filter(|finding| nodes[finding.node].triangles.is_empty()) {
        report[finding.node].role = Role::LeftOut;
    }
}

/// The error about a level that is too large, for which another unit is asked about, or else a node named.
fn too_large(span: Vec3, nodes: &[Node], is_solid: &[bool], unit: Option<Warning>) -> ImportError {
    let advice = match (unit, belongs::largest(nodes, is_solid)) {
        (Some(unit), _) => unit.to_string(),
        (None, Some(idx)) => format!(
            "{} makes it so large; if it is no part of the level, list it under `nodes` as `leave_out` in the sidecar, \
             and if the level is in another unit than metres, use --scale",
            node_label(&nodes[idx].name, nodes[idx].file_idx)
        ),
        (None, None) => {
            "use --scale if it is in another unit than metres (0.01 for centimetres), or split it".to_owned()
        }
    };
    ImportError::TooLarge { span, advice }
}

/// The warning about a level whose unit may not be the metre.
fn other_unit(solids: &[[Vec3; 3]], nodes: &[Node], unit_m: f64) -> Option<Warning> {
    let bounds = |node: &Node| Aabb::around(node.triangles.iter().flatten().copied());
    let named: Vec<(&str, Aabb)> = nodes.iter().filter_map(|node| Some((node.name.as_str(), bounds(node)?))).collect();
    let Suggestion { times, evidence } = units::suggest(solids, &named, unit_m)?;
    Some(Warning::Unit { scale: unit_m * times, evidence })
}

/// What became of each node.
fn report(
    nodes: &[Node<DVec3>],
    meanings: &[Meaning],
    owners: &[Option<usize>],
    frame: &LevelFrame,
) -> Vec<NodeReport> {
    let report = |(idx, node): (usize, &Node<DVec3>)| {
        let own = Aabb::around(node.triangles.iter().flatten().map(|corner| corner.as_vec3()));
        let corners = own.map(|own| [own.low, own.high].map(|corner| frame.to_level(corner)));
        let (role, reason) = match owners[idx] {
            Some(owner) if owner == idx => {
                (meanings[idx].kind.as_ref().map_or(Role::LeftOut, |kind| kind.role()), meanings[idx].reason.clone())
            }
            _ if node.triangles.is_empty() => (Role::Empty, String::new()),
            Some(owner) => {
                let role = meanings[owner].kind.as_ref().map_or(Role::LeftOut, |kind| kind.role());
                (role, format!("it belongs to {}", node_label(&nodes[owner].name, nodes[owner].file_idx)))
            }
            None => (Role::Solid, meanings[idx].reason.clone()),
        };
        NodeReport {
            index: node.file_idx,
            name: node.name.clone(),
            role,
            reason,
            triangles: node.triangles.len(),
            bounds: corners.map(|[one, other]| [one.min(other), one.max(other)]),
        }
    };
    nodes.iter().enumerate().map(report).collect()
}

/// The box around what bodies stand on, swim in and use.
fn bounds(solids: &[[Vec3; 3]], found: &Found) -> Result<Aabb, ImportError> {
    // Polylines have no area and are not solid.
    let has_area = |[a, b, c]: &&[Vec3; 3]| a != b && b != c && c != a;
    let mut bounds = Aabb::around(solids.iter().filter(has_area).flatten().copied()).ok_or(ImportError::Empty)?;
    // The bottom of a pool may be the lowest point of the level; its sides are cut off.
    let (pool_low, pool_high) = found.pool_heights();
    (bounds.low.y, bounds.high.y) = (bounds.low.y.min(pool_low), bounds.high.y.max(pool_high));
    Ok(found.reach.map_or(bounds, |reach| bounds.union(reach)))
}

/// The irregular edges of a level as it was modelled.
fn edges(meshes: &[&mut Vec<[Vec3; 3]>]) -> EdgeCounts {
    let triangles = meshes.iter().flat_map(|triangles| triangles.iter());
    let has_area = |corners: &[Vec3; 3]| Triangle::new(*corners, Surface::Ground).is_some();
    inspect::edges(&triangles.copied().filter(has_area).collect::<Vec<_>>())
}
