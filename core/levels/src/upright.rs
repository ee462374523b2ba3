//! The smallest upright box around a ladder. Between rungs, bodies would slip.

use surefoot_world::map::mover::cuboid;
use surefoot_world::{Aabb, Vec3};

/// Thinnest box, m: what is flat gets a back.
const LEAST_M: f32 = 0.05;

/// The triangles of the smallest upright box around some points, in metres, or none if they are fewer than two.
pub(super) fn upright_box(points: &[Vec3]) -> Vec<[Vec3; 3]> {
    let directions = hull(points).windows(2).map(|pair| (pair[1] - pair[0]).normalize_or_zero()).collect::<Vec<_>>();
    let turned = |along: Vec3| {
        let aside = Vec3::new(-along.z, 0.0, along.x);
        let places = points.iter().map(|at| Vec3::new(at.dot(along), at.y, at.dot(aside)));
        Aabb::around(places).map(|it| (it, along, aside))
    };
    let area = |(Aabb { low, high }, ..): &(Aabb, Vec3, Vec3)| (high.x - low.x) * (high.z - low.z);
    let boxes = directions.into_iter().filter(|it| *it != Vec3::ZERO).filter_map(turned);
    let Some((Aabb { low, high }, along, aside)) = boxes.min_by(|a, b| area(a).total_cmp(&area(b))) else {
        return Vec::new();
    };
    let thin = (Vec3::splat(LEAST_M) - (high - low)).max(Vec3::ZERO) * 0.5;
    let faces = cuboid(low - thin, high + thin);
    faces.into_iter().map(|face| face.map(|at| along * at.x + aside * at.z + Vec3::Y * at.y)).collect()
}

/// The corners of the convex hull of some points seen from above, counter-clockwise; the first one again at the end
/// (Andrew's monotone chain).
fn hull(points: &[Vec3]) -> Vec<Vec3> {
    let mut sorted: Vec<Vec3> = points.iter().map(|at| at.with_y(0.0)).collect();
    sorted.sort_by(|a, b| a.x.total_cmp(&b.x).then(a.z.total_cmp(&b.z)));
    sorted.dedup();
    let half = |points: &mut dyn Iterator<Item = Vec3>| {
        let mut corners: Vec<Vec3> = Vec::new();
        for at in points {
            let turns_back = |corners: &[Vec3]| {
                let [before, last] = *corners.last_chunk::<2>()?;
                let (here, there) = (last - before, at - last);
                Some(here.x * there.z - here.z * there.x <= 0.0)
            };
            while turns_back(&corners) == Some(true) {
                corners.pop();
            }
            corners.push(at);
        }
        corners
    };
    let mut corners = half(&mut sorted.iter().copied());
    let above = half(&mut sorted.iter().rev().copied());
    corners.extend(above.into_iter().skip(1));
    corners
}
