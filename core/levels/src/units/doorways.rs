//! Finds doorways: openings in walls that reach down to the floor.

use crate::units::flats::{Flat, Flats, normal};
use surefoot_world::Vec3;
use surefoot_world::mesh::{Surface, Triangle};

/// Most undersides that are looked at as lintels of doorways.
const MOST_LINTELS: usize = 512;
/// Depth of a lintel over its width, and over the height of its doorway.
const LINTEL_DEPTH: f32 = 0.7;
const DOORWAY_DEPTH: f32 = 0.5;
/// Height of a doorway over its width.
const DOORWAY: std::ops::RangeInclusive<f32> = 1.0..=4.0;
/// Times as large as the lintel that the floor of a doorway is: the sill of a window is not.
const FLOOR: f32 = 3.0;
/// Share of the lintel's width within which the walls beside it must end.
const JAMB: f32 = 0.1;
/// Share of the lintel's width up to which rays do not count: they begin at the lintel.
const NEAR: f32 = 0.001;

/// The underside of a wall above an opening.
#[derive(Clone, Copy)]
struct Lintel {
    centre: Vec3,
    /// Direction along the wall.
    along: Vec3,
    width: f32,
    depth: f32,
}

impl Lintel {
    /// A rectangle along x or z that faces down, as deep as a wall.
    fn new(flat: &Flat) -> Option<Self> {
        let side = flat.bounds.high - flat.bounds.low;
        let (along, width, depth) = if side.x > side.z { (Vec3::X, side.x, side.z) } else { (Vec3::Z, side.z, side.x) };
        let is_rectangle = (flat.area / (width * depth) - 1.0).abs() < JAMB;
        let is_lintel = !flat.faces_up && is_rectangle && depth <= LINTEL_DEPTH * width;
        is_lintel.then(|| Self { centre: flat.centre(), along, width, depth })
    }

    /// A ray from `below` the middle of the lintel.
    fn ray(&self, below: f32, way: Vec3, far: f32) -> Ray {
        Ray { origin: self.centre - Vec3::Y * below, way, near: NEAR * self.width, far }
    }
}

/// The heights of openings below lintels, with floor below and walls at both ends.
pub(super) fn heights(flats: &Flats<'_>) -> Vec<f32> {
    let lintels: Vec<Lintel> = flats.pieces.iter().filter_map(Lintel::new).collect();
    let stride = lintels.len().div_ceil(MOST_LINTELS).max(1);
    let lintels: Vec<Lintel> = lintels.into_iter().step_by(stride).collect();
    let down = |lintel: &Lintel| lintel.ray(0.0, Vec3::NEG_Y, DOORWAY.end() * lintel.width);
    let floors = cast(flats.triangles, &lintels.iter().map(down).collect::<Vec<_>>());
    let open: Vec<(Lintel, f32)> = lintels
        .iter()
        .zip(floors)
        .filter_map(|(lintel, floor)| {
            let Hit { distance: height, triangle } = floor?;
            let area = flats.of_triangles[triangle].map_or(f32::INFINITY, |piece| flats.pieces[piece as usize].area);
            let is_floor = normal(&flats.triangles[triangle]).y > 0.0 && area >= FLOOR * lintel.width * lintel.depth;
            let is_open = DOORWAY.contains(&(height / lintel.width)) && lintel.depth <= DOORWAY_DEPTH * height;
            (is_floor && is_open).then_some((*lintel, height))
        })
        .collect();
    let sideways = open.iter().flat_map(|(lintel, height)| {
        [lintel.along, -lintel.along].map(|way| lintel.ray(0.5 * height, way, lintel.width))
    });
    let walls = cast(flats.triangles, &sideways.collect::<Vec<_>>());
    let ends = |lintel: &Lintel, wall: &Option<Hit>| {
        wall.is_some_and(|hit| (2.0 * hit.distance / lintel.width - 1.0).abs() <= JAMB)
    };
    let between = open.iter().zip(walls.chunks(2));
    let doorways = between.filter(|((lintel, _), walls)| walls.iter().all(|wall| ends(lintel, wall)));
    doorways.map(|((_, height), _)| *height).collect()
}

struct Ray {
    origin: Vec3,
    way: Vec3,
    /// Distances between which the ray counts.
    near: f32,
    far: f32,
}

#[derive(Clone, Copy)]
struct Hit {
    distance: f32,
    triangle: usize,
}

/// The first triangle on each ray.
fn cast(triangles: &[[Vec3; 3]], rays: &[Ray]) -> Vec<Option<Hit>> {
    let mut order: Vec<usize> = (0..rays.len()).collect();
    order.sort_by(|&a, &b| rays[a].origin.x.total_cmp(&rays[b].origin.x));
    let reach = rays.iter().map(|ray| ray.far * ray.way.x.abs()).fold(0.0, f32::max);
    let mut hits: Vec<Option<Hit>> = vec![None; rays.len()];
    for (idx, &corners) in triangles.iter().enumerate() {
        let Some(triangle) = Triangle::new(corners, Surface::Ground) else { continue };
        let (low, high) = triangle.bounds();
        let first = order.partition_point(|&ray| rays[ray].origin.x < low.x - reach);
        let beside = order[first..].iter().take_while(|&&ray| rays[ray].origin.x <= high.x + reach);
        for &number in beside {
            let ray = &rays[number];
            let nearest = hits[number].map_or(ray.far, |hit| hit.distance);
            if let Some(distance) = triangle.ray(ray.origin, ray.way, ray.near, nearest) {
                hits[number] = Some(Hit { distance, triangle: idx });
            }
        }
    }
    hits
}
