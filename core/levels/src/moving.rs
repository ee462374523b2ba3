//! Makes movers of a level's nodes, by their names, extras and animations, and of the sidecar's entries.
//!
//! Nodes: `door*` opens; `lift*`, `elevator*` and `platform*` travel to the places of the nodes `NAME:path`
//! (`NAME:path.001`, ...), in the order of their names; `vanish*` disappears on an order, or in turn; `conveyor*`
//! carries what stands on it with the `velocity` of its extras; `pushable*` is a crate. What a node's animation says of
//! its stops and times counts where names and extras say nothing, and a node of at most 30 m that is animated from
//! place to place is a lift or platform whatever its name is. Lifts and platforms without a path stay solid, like
//! conveyors without a velocity. An extra `mover` with the kind makes a mover of any node, and `mover: false` keeps it
//! solid.

use crate::animated::{Animation, Journey};
use crate::extras::Extras;
use crate::faults::ImportError;
use crate::inspect;
use crate::scene::Node;
use crate::sides;
use glam::DVec3;
use serde::Deserialize;
use std::collections::HashMap;
use surefoot_world::map::LevelFrame;
use surefoot_world::map::mover::{LONGEST_S, MAX_MOVER_SPEED, MAX_NAME_LEN};
use surefoot_world::map::{Mover, MoverKind, MoverStop, mover};
use surefoot_world::mesh::{Surface, Triangle};
use surefoot_world::{Aabb, StopIdx, Vec3};

/// Usual speed of lifts and platforms, m/s, and usual duration of a door's or a floor's change, s.
const TRAVEL_SPEED: f64 = 2.0;
const CHANGE_S: f64 = 1.0;
/// Usual time at each stop, s.
const DWELL_S: f64 = 4.0;
/// Usual angle by which a hinged door opens, degrees.
const HINGE_DEG: f64 = 90.0;
/// How near one of its ends a door's origin must lie for a hinge, as a share of its width.
const HINGE_SHARE: f32 = 0.15;
/// Share of its width by which a sliding door opens.
const SLIDE_SHARE: f32 = 0.96;
/// Distance below which a place on a path is where the mover already is, m.
const SAME_M: f32 = 0.05;
/// Largest extent of what counts as a lift or platform only because it is animated, m.
const LARGEST_M: f32 = 30.0;
/// Most triangles of such a node.
const MOST_TRIANGLES: usize = 2048;
/// Longest part of a node's name before the number in the name of a mover, bytes.
const MOST_NAME_LEN: usize = 48;
/// A node with everything below it.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Whole {
    /// The box around it, m; `None` if it has no triangles.
    pub(super) bounds: Option<Aabb>,
    pub(super) triangle_count: usize,
}

impl Whole {
    /// Whether it may be a lift or platform only because it is animated: whole levels and detailed props stay where
    /// they are.
    fn is_small(&self) -> bool {
        let is_near = |bounds: Aabb| (bounds.high - bounds.low).max_element() <= LARGEST_M;
        self.bounds.is_some_and(is_near) && self.triangle_count <= MOST_TRIANGLES
    }
}

/// The kind of mover that a node is by its name, which begins with a word for `kind`; `None` if the level does not say
/// how it moves.
pub(super) fn named_kind<P>(kind: MoverKind, node: &Node<P>, extras: &Extras<'_>, paths: &Paths) -> Option<MoverKind> {
    let has_path = || {
        let is_marked = paths.places.contains_key(&node.name.to_lowercase());
        extras.has("path") || is_marked || journey(node, &paths.frame).is_some()
    };
    let moves = match kind {
        MoverKind::Lift | MoverKind::Platform => has_path(),
        MoverKind::Conveyor => extras.has("velocity"),
        MoverKind::Door | MoverKind::Floor | MoverKind::Crate => true,
    };
    moves.then_some(kind)
}

/// The kind of mover that a node is only because it is animated.
pub(super) fn animated_kind<P>(node: &Node<P>, paths: &Paths, whole: &Whole) -> Option<MoverKind> {
    let journey = journey(node, &paths.frame).filter(|_| whole.is_small())?;
    Some(if journey.is_upright() { MoverKind::Lift } else { MoverKind::Platform })
}

/// Where the animation of a node takes it.
fn journey<P>(node: &Node<P>, frame: &LevelFrame) -> Option<Journey> {
    node.animation.as_ref()?.journey(|shift| frame.vector_to_map(shift.as_dvec3()))
}

pub(super) fn kind_named(extras: &Extras<'_>, name: &str) -> Result<MoverKind, ImportError> {
    let found = MoverKind::ALL.iter().copied().find(|kind| kind.name() == name);
    found.ok_or_else(|| extras.refuse("mover", name, "must be door, lift, platform, floor, conveyor, crate or false"))
}

/// Splits `lift_2:path.001` into `lift_2` and 1.
pub(super) fn path_of(name: &str) -> Option<(String, u32)> {
    let (stem, rest) = name.rsplit_once(":path")?;
    let digits = rest.trim_start_matches(['.', '_', '-']);
    let number = if digits.is_empty() { 0 } else { digits.parse().ok()? };
    Some((stem.to_owned(), number))
}

/// The paths that the nodes of a level mark.
pub(super) struct Paths {
    /// The frame of the level, in which extras and animations are.
    frame: LevelFrame,
    /// The places of each mover by its name, each with its number.
    places: HashMap<String, Vec<(u32, Place)>>,
}

/// A place on a path.
#[derive(Clone, Copy)]
enum Place {
    /// Where the origin of the mover goes, m.
    Origin(Vec3),
    /// Where the centre of its bottom goes, m.
    Bottom(Vec3),
}

impl Paths {
    pub(super) fn of(nodes: &[Node<DVec3>], frame: LevelFrame) -> Self {
        let mut places: HashMap<String, Vec<(u32, Place)>> = HashMap::new();
        for node in nodes {
            if let Some((stem, number)) = path_of(&node.name.to_lowercase()) {
                let bounds = Aabb::around(node.triangles.iter().flatten().map(|corner| corner.as_vec3()));
                let origin = node.origin.as_vec3();
                let place = bounds.map_or(Place::Origin(origin), |bounds| Place::Bottom(bounds.bottom()));
                places.entry(stem).or_default().push((number, place));
            }
        }
        places.values_mut().for_each(|places| places.sort_by_key(|(number, _)| *number));
        Self { frame, places }
    }

    /// Shifts from where a mover was modelled to its further stops, m.
    fn offsets(&self, node: &Node, bounds: Aabb) -> Vec<Vec3> {
        let slack = Vec3::ONE;
        let origin = node.origin;
        let lies_there = origin.cmpge(bounds.low - slack).all() && origin.cmple(bounds.high + slack).all();
        let places = self.places.get(&node.name.to_lowercase()).map_or(&[][..], Vec::as_slice);
        let offset = |(_, place): &(u32, Place)| match place {
            Place::Origin(at) if lies_there => *at - origin,
            Place::Origin(at) | Place::Bottom(at) => *at - bounds.bottom(),
        };
        places.iter().map(offset).collect()
    }
}

/// What a level says of how a mover moves.
struct Motion {
    /// Shifts to the stops after the first, m.
    path: Vec<Vec3>,
    /// Angle of a hinge, degrees.
    hinge: Option<f64>,
    /// Where its origin and its hinge are, if the level says so, m.
    origin: Option<Vec3>,
    pivot: Option<Vec3>,
    /// Duration of each journey, s, or speed, m/s.
    seconds: Option<f64>,
    speed: Option<f64>,
    dwell: Option<f64>,
    cycles: Option<bool>,
    velocity: Option<Vec3>,
    start: StopIdx,
}

/// What the animation of a node says of how a mover moves.
#[derive(Default)]
struct Animated {
    /// Shift to the first stop, m.
    begin: Option<Vec3>,
    /// Shifts from there to the others, m.
    path: Vec<Vec3>,
    /// Angle by which a door turns, degrees.
    swing: Option<f64>,
    travel_s: Option<f32>,
    dwell_s: Option<f32>,
}

impl Animated {
    fn of(kind: MoverKind, node: &Node, frame: &LevelFrame, bounds: Aabb) -> Self {
        let swing = node.animation.as_ref().and_then(Animation::swing);
        let journey = match (kind, swing) {
            (MoverKind::Door, Some((turn, seconds))) => {
                let arm = (bounds.high - bounds.low).length();
                let travel_s = seconds.max(turn.abs() * arm / MAX_MOVER_SPEED).min(LONGEST_S);
                return Self { swing: Some(turn.to_degrees().into()), travel_s: Some(travel_s), ..Self::default() };
            }
            (MoverKind::Door, None) => journey(node, frame).map(Journey::without_stops_between),
            (MoverKind::Lift | MoverKind::Platform, _) => journey(node, frame),
            (MoverKind::Floor | MoverKind::Conveyor | MoverKind::Crate, _) => None,
        };
        let Some(Journey { begin, path, travel_s, dwell_s }) = journey else { return Self::default() };
        let legs = std::iter::once(Vec3::ZERO).chain(path.iter().copied()).zip(&path);
        let longest = legs.map(|(from, to)| from.distance(*to)).fold(0.0, f32::max);
        let travel_s = travel_s.max(longest / MAX_MOVER_SPEED).min(LONGEST_S);
        let dwell_s = dwell_s.min(LONGEST_S);
        Self { begin: Some(begin), path, swing: None, travel_s: Some(travel_s), dwell_s: Some(dwell_s) }
    }
}

/// Makes a mover of a node whose triangles, with those of its children, are `triangles`.
pub(super) fn from_node(
    kind: MoverKind,
    node: &Node,
    extras: &Extras<'_>,
    paths: &Paths,
    mut triangles: Vec<[Vec3; 3]>,
) -> Result<Option<Mover>, ImportError> {
    let frame = &paths.frame;
    let Some(bounds) = Aabb::around(triangles.iter().flatten().copied()) else { return Ok(None) };
    let metres = |vector: DVec3| frame.vector_to_map(vector);
    let mut path = extras.vectors("path")?.into_iter().map(metres).collect::<Vec<_>>();
    path.extend(extras.vector("slide")?.map(metres));
    path.extend(paths.offsets(node, bounds));
    let animated = if path.is_empty() { Animated::of(kind, node, frame, bounds) } else { Animated::default() };
    path.extend(animated.path);
    if let Some(begin) = animated.begin {
        triangles.iter_mut().flatten().for_each(|corner| *corner += begin);
    }
    let bounds = Aabb::around(triangles.iter().flatten().copied()).unwrap_or(bounds);
    let motion = Motion {
        path,
        hinge: extras.number("hinge")?.or(animated.swing),
        origin: Some(node.origin),
        pivot: animated.swing.map(|_| node.origin),
        seconds: extras.number("seconds")?.or(animated.travel_s.map(f64::from)),
        speed: extras.number("speed")?,
        dwell: extras.number("dwell")?.or(animated.dwell_s.map(f64::from)),
        cycles: extras.flag("loop")?,
        velocity: extras.vector("velocity")?.map(metres),
        start: StopIdx(u8::from(extras.flag("open")? == Some(true))),
    };
    let triangles = solid(triangles);
    // What has no area holds nothing.
    Ok((!triangles.is_empty()).then(|| assemble(node.name.clone(), kind, triangles, bounds, motion)))
}

/// The name of a mover that is a node: files do not keep names short and unique. It is the name of the node, with the
/// number of the node if it is too long or another mover has it.
pub(super) fn distinct_name(name: &str, node_idx: usize, others: &[Mover]) -> String {
    let is_free = (1..=MAX_NAME_LEN).contains(&name.len()) && others.iter().all(|other| other.name != name);
    if is_free {
        return name.to_owned();
    }
    let end = (0..=MOST_NAME_LEN.min(name.len())).rev().find(|end| name.is_char_boundary(*end)).unwrap_or(0);
    format!("{}.{node_idx}", if name.is_empty() { "animated" } else { &name[..end] })
}

/// Gives both sides to what is no closed body, and turns what lies inside out.
fn solid(mut triangles: Vec<[Vec3; 3]>) -> Vec<[Vec3; 3]> {
    triangles.retain(|corners| Triangle::new(*corners, Surface::Ground).is_some());
    sides::turn(&mut [&mut triangles]);
    if inspect::edges(&triangles).open > 0 {
        let backs: Vec<[Vec3; 3]> = triangles.iter().map(|[a, b, c]| [*a, *c, *b]).collect();
        triangles.extend(backs);
    }
    triangles
}

fn assemble(name: String, kind: MoverKind, triangles: Vec<[Vec3; 3]>, bounds: Aabb, motion: Motion) -> Mover {
    let here = MoverStop { offset: Vec3::ZERO, yaw: 0.0, is_there: true };
    let along = |offset: Vec3| MoverStop { offset, ..here };
    let mut stops = vec![here];
    stops.extend(motion.path.iter().filter(|offset| offset.length() > SAME_M).map(|offset| along(*offset)));
    let mut pivot = bounds.bottom();
    match kind {
        MoverKind::Door => {
            let leaf = Leaf::new(bounds);
            let hinge = leaf.hinge(motion.origin);
            if motion.hinge.is_some() || (stops.len() == 1 && hinge.is_some()) {
                pivot = motion.pivot.or(hinge).unwrap_or_else(|| leaf.end());
                let angle = motion.hinge.unwrap_or(HINGE_DEG) as f32;
                stops = vec![here, MoverStop { yaw: angle.to_radians(), ..here }];
            } else if stops.len() == 1 {
                stops.push(along(leaf.along * (leaf.width * SLIDE_SHARE)));
            }
            stops.truncate(2);
        }
        MoverKind::Floor => stops = vec![here, MoverStop { is_there: false, ..here }],
        MoverKind::Conveyor | MoverKind::Crate => stops.truncate(1),
        MoverKind::Lift | MoverKind::Platform => {}
    }
    let farthest = stops.windows(2).map(|pair| pair[0].offset.distance(pair[1].offset)).fold(0.0, f32::max);
    let speed = motion.speed.or(kind.is_ridden().then_some(TRAVEL_SPEED));
    let usual = speed.map_or(CHANGE_S, |speed| f64::from(farthest) / speed.max(1.0e-3));
    // Wide doors take longer.
    let turned = stops.iter().map(|stop| stop.yaw.abs()).fold(0.0, f32::max);
    let arm = (bounds.high - bounds.low).length();
    let usual = usual.max(f64::from(farthest.max(turned * arm) / MAX_MOVER_SPEED));
    Mover {
        name,
        kind,
        triangles,
        pivot,
        stops,
        start: motion.start,
        travel_s: motion.seconds.unwrap_or(usual) as f32,
        dwell_s: motion.dwell.unwrap_or(DWELL_S) as f32,
        cycles: motion.cycles.unwrap_or(kind.is_ridden()),
        belt: motion.velocity.unwrap_or(Vec3::ZERO),
    }
}

/// A door seen from above.
struct Leaf {
    bounds: Aabb,
    /// Direction of its width.
    along: Vec3,
    width: f32,
}

impl Leaf {
    fn new(bounds: Aabb) -> Self {
        let size = bounds.high - bounds.low;
        let along = if size.x >= size.z { Vec3::X } else { Vec3::Z };
        Self { bounds, along, width: size.x.max(size.z) }
    }

    /// One end of its bottom.
    fn end(&self) -> Vec3 {
        self.bounds.bottom() - self.along * (0.5 * self.width)
    }

    /// The place of its hinges, if its origin is one.
    fn hinge(&self, origin: Option<Vec3>) -> Option<Vec3> {
        let origin = origin?;
        let offset = origin - self.bounds.bottom();
        let across = Vec3::new(offset.x, 0.0, offset.z) - self.along * offset.dot(self.along);
        let from_end = (offset.dot(self.along).abs() - 0.5 * self.width).abs();
        (from_end <= HINGE_SHARE * self.width && across.length() <= 0.5 * self.width).then_some(origin)
    }
}

/// A mover in the sidecar: a box.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct MoverEntry {
    name: String,
    kind: MoverKind,
    min: [f64; 3],
    max: [f64; 3],
    #[serde(default)]
    path: Vec<[f64; 3]>,
    hinge: Option<f64>,
    seconds: Option<f64>,
    speed: Option<f64>,
    dwell: Option<f64>,
    #[serde(rename = "loop")]
    cycles: Option<bool>,
    velocity: Option<[f64; 3]>,
    #[serde(default)]
    open: bool,
}

impl MoverEntry {
    /// The mover in metres; `None` if its box has no volume.
    pub(super) fn mover(self, frame: &LevelFrame) -> Option<Mover> {
        let metres = |vector: [f64; 3]| frame.vector_to_map(vector.into());
        let (one, other) = (frame.to_map(self.min.into()), frame.to_map(self.max.into()));
        let bounds = Aabb::at(one).union(Aabb::at(other));
        // Also false for NaN.
        let has_volume = (bounds.high - bounds.low).min_element() > 0.0;
        let motion = Motion {
            path: self.path.into_iter().map(metres).collect(),
            hinge: self.hinge,
            origin: None,
            pivot: None,
            seconds: self.seconds,
            speed: self.speed,
            dwell: self.dwell,
            cycles: self.cycles,
            velocity: self.velocity.map(metres),
            start: StopIdx(u8::from(self.open)),
        };
        has_volume.then(|| assemble(self.name, self.kind, mover::cuboid(bounds.low, bounds.high), bounds, motion))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_path_is_named_after_its_mover() {
        assert_eq!(path_of("lift_2:path.012"), Some(("lift_2".to_owned(), 12)));
        assert_eq!(path_of("lift:path"), Some(("lift".to_owned(), 0)));
        assert_eq!(path_of("garden_path"), None);
        assert_eq!(path_of("lift:pathway"), None);
    }
}
