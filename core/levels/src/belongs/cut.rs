//! Cuts triangles at the sides of a box.

use crate::belongs::bounds::Bounds;
use glam::DVec3;

/// Axes across which triangles are cut.
const SIDEWAYS: [usize; 2] = [0, 2];
const ALL: [usize; 3] = [0, 1, 2];

/// The parts of the triangles that lie within the box along x and z; the height of the box does not matter. Fronts stay
/// fronts, and cuts lie exactly at the sides of the box.
pub(super) fn clip(triangles: &[[DVec3; 3]], within: Bounds) -> Vec<[DVec3; 3]> {
    let mut clipped = Vec::with_capacity(triangles.len());
    for triangle in triangles {
        let polygon = cut(triangle, within, &SIDEWAYS);
        let fan = polygon.windows(2).skip(1).map(|edge| [polygon[0], edge[0], edge[1]]);
        clipped.extend(fan.filter(|[a, b, c]| (*b - *a).cross(*c - *a) != DVec3::ZERO));
    }
    clipped
}

/// Whether a triangle and the box share a point.
pub(super) fn touches(triangle: &[DVec3; 3], within: Bounds) -> bool {
    let bounds = Bounds::around(triangle.iter().copied());
    bounds.distance(within) == 0.0 && !cut(triangle, within, &ALL).is_empty()
}

/// The convex polygon that is left of a triangle within the box along `axes`; empty if nothing is.
fn cut(triangle: &[DVec3; 3], within: Bounds, axes: &[usize]) -> Vec<DVec3> {
    let mut polygon = triangle.to_vec();
    for &axis in axes {
        polygon = above(&polygon, axis, within.low[axis], 1.0);
        polygon = above(&polygon, axis, within.high[axis], -1.0);
    }
    polygon
}

/// The part of a polygon above `limit` along an axis, or below it if `sign` is -1 (Sutherland and Hodgman 1974).
fn above(polygon: &[DVec3], axis: usize, limit: f64, sign: f64) -> Vec<DVec3> {
    let is_kept = |point: DVec3| (point[axis] - limit) * sign >= 0.0;
    let mut kept = Vec::with_capacity(polygon.len() + 1);
    for (idx, &to) in polygon.iter().enumerate() {
        let from = polygon[(idx + polygon.len() - 1) % polygon.len()];
        if is_kept(from) != is_kept(to) {
            kept.push(crossing(from, to, axis, limit));
        }
        if is_kept(to) {
            kept.push(to);
        }
    }
    kept
}

/// The point of an edge at `limit` along an axis. Both triangles beside the edge get the same point.
fn crossing(from: DVec3, to: DVec3, axis: usize, limit: f64) -> DVec3 {
    let (low, high) = if from[axis] < to[axis] { (from, to) } else { (to, from) };
    let mut point = low + (high - low) * ((limit - low[axis]) / (high[axis] - low[axis]));
    point[axis] = limit;
    point
}

#[cfg(test)]
mod tests {
    use super::*;

    fn double_area([a, b, c]: [DVec3; 3]) -> DVec3 {
        (b - a).cross(c - a)
    }

    #[test]
    fn what_is_left_of_a_plane_is_the_box_and_faces_up() {
        let corner = |x: f64, z: f64| DVec3::new(x, 3.0, z);
        let [a, b, c, d] = [(-1000.0, -900.0), (-1000.0, 900.0), (1000.0, 900.0), (1000.0, -900.0)];
        let plane = [[a, b, c], [a, c, d]].map(|triangle| triangle.map(|(x, z)| corner(x, z)));
        let within = Bounds { low: DVec3::new(-7.3, 50.0, -4.1), high: DVec3::new(11.9, 60.0, 6.7) };
        let left = clip(&plane, within);
        let bounds = Bounds::around(left.iter().flatten().copied());
        assert_eq!((bounds.low.x, bounds.low.z, bounds.high.x, bounds.high.z), (-7.3, -4.1, 11.9, 6.7));
        assert_eq!((bounds.low.y, bounds.high.y), (3.0, 3.0));
        assert!(left.iter().all(|&triangle| double_area(triangle).y > 0.0));
        let area: f64 = left.iter().map(|&triangle| double_area(triangle).y / 2.0).sum();
        assert!((area - 19.2 * 10.8).abs() < 1e-9, "{area}");
    }

    #[test]
    fn triangles_inside_stay_and_those_outside_go() {
        let inside = [DVec3::ZERO, DVec3::X, DVec3::Z];
        let outside = inside.map(|corner| corner + DVec3::X * 10.0);
        let within = Bounds { low: DVec3::splat(-2.0), high: DVec3::splat(2.0) };
        assert_eq!(clip(&[inside, outside], within), [inside]);
        assert!(touches(&inside, within) && !touches(&outside, within));
        // Its bounds share points with the box, but it does not.
        assert!(!touches(&[DVec3::X * 5.0, DVec3::Z * 5.0, DVec3::new(5.0, 1.0, 5.0)], within));
    }
}
