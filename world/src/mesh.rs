//! Triangles in a uniform grid: the one structure behind both contacts and rays.
//!
//! Each cell lists the triangles whose bounds touch it; a cell without any holds how many cells (Chebyshev
//! distance) it is certainly away from the nearest one with triangles, so that rays leap over empty space.
//! parry3d's triangle is the reference: property tests hold rays and contacts against it.

use crate::{Vec3, parallel};

/// Side of a grid cell in metres.
const CELL_M: f32 = 1.6;
/// Its inverse.
const CELLS_PER_M: f32 = 1.0 / CELL_M;
/// Barycentric slack that closes the seams between neighbouring triangles for rays.
const SEAM_SLACK: f32 = 1.0e-4;
/// Slack around the stretch of a ray inside one cell, m.
const STRETCH_SLACK_M: f32 = 1.0e-3;
/// Longest empty-space skip that is stored, in cells.
const MAX_SKIP: u8 = 15;

/// Cells below which starting threads takes longer than the work.
const CELLS_WORTH_THREADS: usize = 1 << 16;

/// What a triangle is made of.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum Surface {
    /// Rock, building, plateau: solid.
    Ground = 0,
    /// Surface of a water pool: seen by rays, walked through.
    Water = 1,
    /// Surface of a lava pool: seen by rays, fallen into.
    Lava = 2,
    /// A jump pad: seen by rays, triggers by position.
    Pad = 3,
    /// Station of a zip line: likewise.
    ZipLine = 4,
    /// Entrance of a teleporter: likewise.
    Teleporter = 5,
    /// A jetpack to pick up: likewise.
    Jetpack = 6,
}

impl Surface {
    /// All surfaces, by their number.
    pub const ALL: [Surface; 7] = [
        Surface::Ground,
        Surface::Water,
        Surface::Lava,
        Surface::Pad,
        Surface::ZipLine,
        Surface::Teleporter,
        Surface::Jetpack,
    ];

    /// Whether bodies collide with it.
    pub fn is_solid(self) -> bool {
        self == Surface::Ground
    }
}

/// One triangle with its precomputed edges and normal.
#[derive(Debug, Clone, Copy)]
pub struct Triangle {
    a: Vec3,
    ab: Vec3,
    ac: Vec3,
    normal: Vec3,
    surface: Surface,
}

impl Triangle {
    /// A triangle with corners in counter-clockwise order seen from outside; `None` if it has no area.
    pub fn new([a, b, c]: [Vec3; 3], surface: Surface) -> Option<Self> {
        let (ab, ac) = (b - a, c - a);
        let cross = ab.cross(ac);
        let length = cross.length();
        (length > 1.0e-9).then(|| Self { a, ab, ac, normal: cross / length, surface })
    }

    /// The three corners.
    pub fn corners(&self) -> [Vec3; 3] {
        [self.a, self.a + self.ab, self.a + self.ac]
    }

    /// Unit normal, pointing out of the rock.
    pub fn normal(&self) -> Vec3 {
        self.normal
    }

    /// What it is made of.
    pub fn surface(&self) -> Surface {
        self.surface
    }

    fn bounds(&self) -> (Vec3, Vec3) {
        let [a, b, c] = self.corners();
        (a.min(b).min(c), a.max(b).max(c))
    }

    /// Two-sided intersection inside `near..=far` along the ray: plane first, which settles most cases, then barycentric
    /// coordinates, slightly widened so that seams do not leak.
    #[inline]
    fn ray(&self, origin: Vec3, direction: Vec3, near: f32, far: f32) -> Option<f32> {
        let offset = origin - self.a;
        let distance = -self.normal.dot(offset) / self.normal.dot(direction);
        // Also refuses the NaN of a ray inside the plane.
        if !(distance >= near && distance <= far) {
            return None;
        }
        let point = offset + direction * distance;
        let (ab, ac) = (self.ab, self.ac);
        let (bb, bc, cc) = (ab.dot(ab), ab.dot(ac), ac.dot(ac));
        let (pb, pc) = (point.dot(ab), point.dot(ac));
        let area = bb * cc - bc * bc;
        let (b, c) = (cc * pb - bc * pc, bb * pc - bc * pb);
        let slack = -SEAM_SLACK * area;
        (b >= slack && c >= slack && b + c <= area - slack).then_some(distance)
    }

    /// Closest point of the triangle to `point` when that lies in its interior or on its border
    /// (Ericson, Real-Time Collision Detection, 5.1.5).
    fn closest_point(&self, point: Vec3) -> Vec3 {
        let (ab, ac, a) = (self.ab, self.ac, self.a);
        let ap = point - a;
        let (d1, d2) = (ab.dot(ap), ac.dot(ap));
        if d1 <= 0.0 && d2 <= 0.0 {
            return a;
        }
        let bp = ap - ab;
        let (d3, d4) = (ab.dot(bp), ac.dot(bp));
        if d3 >= 0.0 && d4 <= d3 {
            return a + ab;
        }
        let vc = d1 * d4 - d3 * d2;
        if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
            return a + ab * (d1 / (d1 - d3));
        }
        let cp = ap - ac;
        let (d5, d6) = (ab.dot(cp), ac.dot(cp));
        if d6 >= 0.0 && d5 <= d6 {
            return a + ac;
        }
        let vb = d5 * d2 - d1 * d6;
        if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
            return a + ac * (d2 / (d2 - d6));
        }
        let va = d3 * d6 - d5 * d4;
        if va <= 0.0 && d4 - d3 >= 0.0 && d5 - d6 >= 0.0 {
            let t = (d4 - d3) / ((d4 - d3) + (d5 - d6));
            return a + ab + (ac - ab) * t;
        }
        let scale = 1.0 / (va + vb + vc);
        a + ab * (vb * scale) + ac * (vc * scale)
    }

    /// Penetration of an upright capsule, if any.
    ///
    /// The capsule is the vertical segment of length `height` above `low`, widened by `radius`. Contacts from
    /// behind are ignored: solids are entered only through a bug, and pushing outwards then makes it worse.
    #[inline]
    pub fn capsule_contact(&self, low: Vec3, height: f32, radius: f32) -> Option<Contact> {
        let low_side = self.normal.dot(low - self.a);
        let high_side = low_side + self.normal.y * height;
        if low_side.min(high_side) > radius || low_side.max(high_side) < 0.0 {
            return None;
        }
        if low_side.min(high_side) < 0.0 {
            // The segment crosses the plane: if it does so inside the triangle, push its buried end out.
            let t = low_side / (low_side - high_side);
            let crossing = low + Vec3::new(0.0, height * t, 0.0);
            if self.closest_point(crossing).distance_squared(crossing) < 1.0e-8 {
                let depth = radius - low_side.min(high_side);
                return Some(Contact { normal: self.normal, depth, point: crossing, face_normal: self.normal });
            }
        }
        let (on_axis, on_triangle) = self.closest_to_vertical(low, height);
        let offset = on_axis - on_triangle;
        let distance_squared = offset.length_squared();
        if distance_squared >= radius * radius || offset.dot(self.normal) <= 0.0 {
            return None;
        }
        let distance = distance_squared.sqrt();
        let normal = if distance > 1.0e-5 { offset / distance } else { self.normal };
        Some(Contact { normal, depth: radius - distance, point: on_triangle, face_normal: self.normal })
    }

    /// Closest pair of points between the vertical segment above `low` and the triangle, for a segment that
    /// does not pass through it.
    #[inline]
    fn closest_to_vertical(&self, low: Vec3, height: f32) -> (Vec3, Vec3) {
        let high = low + Vec3::new(0.0, height, 0.0);
        let mut best = (low, self.closest_point(low));
        let mut best_squared = best.0.distance_squared(best.1);
        let mut offer = |pair: (Vec3, Vec3)| {
            let squared = pair.0.distance_squared(pair.1);
            if squared < best_squared {
                (best, best_squared) = (pair, squared);
            }
        };
        offer((high, self.closest_point(high)));
        let [a, b, c] = self.corners();
        for (from, to) in [(a, b), (b, c), (c, a)] {
            offer(closest_vertical_to_edge(low, height, from, to));
        }
        best
    }
}

/// Closest points between a vertical segment and an edge.
#[inline]
fn closest_vertical_to_edge(low: Vec3, height: f32, from: Vec3, to: Vec3) -> (Vec3, Vec3) {
    let edge = to - from;
    let offset = low - from;
    let horizontal_squared = edge.x * edge.x + edge.z * edge.z;
    let mut t = if horizontal_squared > 1.0e-12 {
        ((offset.x * edge.x + offset.z * edge.z) / horizontal_squared).clamp(0.0, 1.0)
    } else {
        0.5
    };
    let y_on_edge = from.y + edge.y * t;
    let y_on_axis = y_on_edge.clamp(low.y, low.y + height);
    if y_on_axis != y_on_edge || horizontal_squared <= 1.0e-12 {
        // The infinite axis meets the edge beyond the segment's end: take the end against the edge.
        let end = Vec3::new(low.x, y_on_axis, low.z);
        t = ((end - from).dot(edge) / edge.length_squared()).clamp(0.0, 1.0);
        let on_edge = from + edge * t;
        let y = on_edge.y.clamp(low.y, low.y + height);
        return (Vec3::new(low.x, y, low.z), on_edge);
    }
    (Vec3::new(low.x, y_on_axis, low.z), from + edge * t)
}

/// Centre of a grid cell.
#[inline]
fn centre_of([x, y, z]: [i32; 3]) -> Vec3 {
    (Vec3::new(x as f32, y as f32, z as f32) + Vec3::splat(0.5)) * CELL_M
}

/// A penetration of a capsule into a triangle.
#[derive(Debug, Clone, Copy)]
pub struct Contact {
    /// Unit direction that separates the two fastest, away from the triangle.
    pub normal: Vec3,
    /// Penetration in metres, positive.
    pub depth: f32,
    /// The touched point on the triangle.
    pub point: Vec3,
    /// Normal of the touched triangle; differs from `normal` on its edges.
    pub face_normal: Vec3,
}

/// Where a ray ended.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RayHit {
    /// Metres along the ray.
    pub distance: f32,
    /// Index of the triangle that was hit.
    pub triangle_idx: u32,
    /// What was hit.
    pub surface: Surface,
}

/// Set in the entry of a cell without triangles; the rest is how many cells (Chebyshev) it is certainly away from
/// the nearest one with triangles.
const EMPTY: u32 = 1 << 31;

/// The triangles of one occupied cell.
#[derive(Debug, Clone, Copy)]
struct Occupied {
    /// Its first item; it ends where the next cell's begin.
    start: u32,
    /// Lowest and highest y that its triangles reach, m: rays that pass above or below are not tested.
    lowest: f32,
    highest: f32,
}

/// Triangles with the grid that finds them.
#[derive(Debug)]
pub struct Mesh {
    triangles: Vec<Triangle>,
    counts: [i32; 3],
    /// For each cell [`EMPTY`] with its distance, or its index among the occupied ones.
    cells: Vec<u32>,
    /// In the order of their cells, with one more at the end.
    occupied: Vec<Occupied>,
    /// Triangles of each occupied cell, in the order of the cells.
    items: Vec<u32>,
}

impl Mesh {
    /// Indexes `triangles` inside the box from the origin to `extent`.
    pub fn new(triangles: Vec<Triangle>, extent: Vec3) -> Self {
        let counts = extent.to_array().map(|side| ((side / CELL_M).ceil() as i32).max(1));
        let cell_count = counts.iter().map(|&count| count as usize).product::<usize>();
        let mut mesh = Self { triangles, counts, cells: Vec::new(), occupied: Vec::new(), items: Vec::new() };
        let mut cells = vec![0u32; cell_count];
        mesh.for_each_cell_of_triangles(|cell, _| cells[cell] += 1);
        let skips = mesh.empty_space_skips(&cells);
        let mut item_count = 0;
        let mut occupied = Vec::new();
        for (cell, skip) in cells.iter_mut().zip(skips) {
            if *cell == 0 {
                *cell = EMPTY | u32::from(skip);
                continue;
            }
            let triangle_count = std::mem::replace(cell, occupied.len() as u32);
            occupied.push(Occupied { start: item_count, lowest: f32::INFINITY, highest: f32::NEG_INFINITY });
            item_count += triangle_count;
        }
        let mut ends: Vec<u32> = occupied.iter().map(|range| range.start).collect();
        occupied.push(Occupied { start: item_count, lowest: 0.0, highest: 0.0 });
        let mut items = vec![0u32; item_count as usize];
        mesh.for_each_cell_of_triangles(|cell, triangle_idx| {
            let idx = cells[cell] as usize;
            items[ends[idx] as usize] = triangle_idx;
            ends[idx] += 1;
            let (low, high) = mesh.triangles[triangle_idx as usize].bounds();
            occupied[idx].lowest = occupied[idx].lowest.min(low.y);
            occupied[idx].highest = occupied[idx].highest.max(high.y);
        });
        (mesh.cells, mesh.occupied, mesh.items) = (cells, occupied, items);
        mesh
    }

    /// All triangles, in a fixed order.
    pub fn triangles(&self) -> &[Triangle] {
        &self.triangles
    }

    /// Gives the triangles back.
    pub(crate) fn into_triangles(self) -> Vec<Triangle> {
        self.triangles
    }

    /// Bytes held by the triangles and their grid.
    pub fn memory_bytes(&self) -> usize {
        std::mem::size_of_val(self.triangles.as_slice())
            + std::mem::size_of_val(self.cells.as_slice())
            + std::mem::size_of_val(self.occupied.as_slice())
            + std::mem::size_of_val(self.items.as_slice())
    }

    /// Triangles of an occupied cell.
    #[inline]
    fn items_of(&self, occupied_idx: usize) -> &[u32] {
        let range = self.occupied[occupied_idx].start as usize..self.occupied[occupied_idx + 1].start as usize;
        &self.items[range]
    }

    fn cell_idx(&self, [x, y, z]: [i32; 3]) -> usize {
        ((z * self.counts[1] + y) * self.counts[0] + x) as usize
    }

    fn cell_of(&self, point: Vec3) -> [i32; 3] {
        // Truncation rounds towards zero, which is the floor wherever the grid has cells.
        [point.x, point.y, point.z].map(|c| (c * CELLS_PER_M) as i32)
    }

    fn clamped_cells(&self, low: Vec3, high: Vec3) -> ([i32; 3], [i32; 3]) {
        let clamp = |cell: [i32; 3]| [0, 1, 2].map(|axis| cell[axis].clamp(0, self.counts[axis] - 1));
        (clamp(self.cell_of(low)), clamp(self.cell_of(high)))
    }

    fn for_each_cell_of_triangles(&self, mut visit: impl FnMut(usize, u32)) {
        // Slightly widened bounds, so that a triangle on a cell's border is found from both sides.
        let slack = Vec3::splat(1.0e-3);
        let half = Vec3::splat(CELL_M * 0.5 + 1.0e-3);
        for (idx, triangle) in self.triangles.iter().enumerate() {
            let (low, high) = triangle.bounds();
            let (from, to) = self.clamped_cells(low - slack, high + slack);
            for z in from[2]..=to[2] {
                for y in from[1]..=to[1] {
                    for x in from[0]..=to[0] {
                        let centre = centre_of([x, y, z]);
                        let reach = triangle.normal.abs().dot(half);
                        let on_border =
                            [(x, 0), (y, 1), (z, 2)].iter().any(|&(c, axis)| c == 0 || c == self.counts[axis] - 1);
                        if on_border || triangle.normal.dot(centre - triangle.a).abs() <= reach {
                            visit(self.cell_idx([x, y, z]), idx as u32);
                        }
                    }
                }
            }
        }
    }

    /// Chebyshev distance transform of the cells with a count above 0, capped at [`MAX_SKIP`].
    ///
    /// It separates by axis: the distance along x first, then `min over j of max(d(j), |i - j|)` along y and z, row
    /// by row so that the inner loops run over consecutive bytes.
    fn empty_space_skips(&self, triangle_counts: &[u32]) -> Vec<u8> {
        let [nx, ny, nz] = self.counts.map(|count| count as usize);
        let threads = if triangle_counts.len() < CELLS_WORTH_THREADS { 1 } else { parallel::core_count() };
        let slab_len = nx * ny;
        let mut along_x = vec![0u8; triangle_counts.len()];
        parallel::for_each_slab(&mut along_x, nx, threads, |row_idx, row| {
            let counts = &triangle_counts[row_idx * nx..(row_idx + 1) * nx];
            let mut distance = MAX_SKIP;
            for (value, &count) in row.iter_mut().zip(counts) {
                distance = if count > 0 { 0 } else { (distance + 1).min(MAX_SKIP) };
                *value = distance;
            }
            for value in row.iter_mut().rev() {
                distance = if *value == 0 { 0 } else { (distance + 1).min(*value) };
                *value = distance;
            }
        });
        let combine = |into: &mut [u8], from: &[u8], reach: u8| {
            for (value, &other) in into.iter_mut().zip(from) {
                *value = (*value).min(other.max(reach));
            }
        };
        let mut along_xy = along_x.clone();
        parallel::for_each_slab(&mut along_xy, slab_len, threads, |z, slab| {
            for y in 0..ny {
                let into = &mut slab[y * nx..(y + 1) * nx];
                for reach in 1..MAX_SKIP {
                    let row = |y: usize| &along_x[z * slab_len + y * nx..z * slab_len + (y + 1) * nx];
                    if let Some(below) = y.checked_sub(usize::from(reach)) {
                        combine(into, row(below), reach);
                    }
                    if y + usize::from(reach) < ny {
                        combine(into, row(y + usize::from(reach)), reach);
                    }
                }
            }
        });
        let mut skips = along_x;
        skips.copy_from_slice(&along_xy);
        parallel::for_each_slab(&mut skips, slab_len, threads, |z, slab| {
            for reach in 1..MAX_SKIP {
                let layer = |z: usize| &along_xy[z * slab_len..(z + 1) * slab_len];
                if let Some(before) = z.checked_sub(usize::from(reach)) {
                    combine(slab, layer(before), reach);
                }
                if z + usize::from(reach) < nz {
                    combine(slab, layer(z + usize::from(reach)), reach);
                }
            }
        });
        skips
    }

    /// First triangle along the ray within `max_distance` metres; `direction` must have unit length.
    pub fn cast_ray(&self, origin: Vec3, direction: Vec3, max_distance: f32) -> Option<RayHit> {
        let mut travelled = self.enter(origin, direction)?;
        let inverse = Vec3::new(1.0 / direction.x, 1.0 / direction.y, 1.0 / direction.z);
        let step = [direction.x, direction.y, direction.z].map(|d| if d > 0.0 { 1 } else { -1 });
        // Cells are left by their upper border where the ray grows.
        let upper = step.map(|step| (step + 1) / 2);
        let entry = self.cell_of(origin + direction * travelled);
        let mut cell = [0, 1, 2].map(|axis| entry[axis].clamp(0, self.counts[axis] - 1));
        while travelled <= max_distance {
            if (0..3).any(|axis| cell[axis] as u32 >= self.counts[axis] as u32) {
                return None;
            }
            let entry = self.cells[self.cell_idx(cell)];
            // Leave this cell, or the block of cells around it that is known to be empty.
            let margin = if entry & EMPTY == 0 { 0 } else { (entry & !EMPTY) as i32 - 1 };
            let exit = |axis: usize, o: f32, inverse: f32| {
                let border = (cell[axis] + upper[axis] + step[axis] * margin) as f32 * CELL_M;
                if inverse.is_finite() { (border - o) * inverse } else { f32::INFINITY }
            };
            let exits = [exit(0, origin.x, inverse.x), exit(1, origin.y, inverse.y), exit(2, origin.z, inverse.z)];
            let axis = if exits[0] <= exits[1] && exits[0] <= exits[2] {
                0
            } else if exits[1] <= exits[2] {
                1
            } else {
                2
            };
            let leave = exits[axis].max(travelled);
            if entry & EMPTY == 0
                && let Some(hit) = self.cast_in_cell(
                    entry as usize,
                    (origin, direction),
                    ((travelled - STRETCH_SLACK_M).max(0.0), (leave + STRETCH_SLACK_M).min(max_distance)),
                )
            {
                return Some(hit);
            }
            travelled = leave;
            if margin > 0 {
                let moved = self.cell_of(origin + direction * travelled);
                for other in 0..3 {
                    if other != axis {
                        cell[other] = moved[other].clamp(cell[other] - margin, cell[other] + margin);
                    }
                }
            }
            cell[axis] += step[axis] * (1 + margin);
        }
        None
    }

    /// First triangle of one cell on a stretch of a ray. A hit beyond the cell is found where it lies.
    #[inline]
    fn cast_in_cell(
        &self,
        occupied_idx: usize,
        (origin, direction): (Vec3, Vec3),
        (near, far): (f32, f32),
    ) -> Option<RayHit> {
        let (y0, y1) = (origin.y + direction.y * near, origin.y + direction.y * far);
        let Occupied { lowest, highest, .. } = self.occupied[occupied_idx];
        if y0.max(y1) < lowest - STRETCH_SLACK_M || y0.min(y1) > highest + STRETCH_SLACK_M {
            return None;
        }
        let mut best: Option<RayHit> = None;
        for &triangle_idx in self.items_of(occupied_idx) {
            let triangle = &self.triangles[triangle_idx as usize];
            let far = best.map_or(far, |hit| hit.distance);
            if let Some(distance) = triangle.ray(origin, direction, near, far) {
                best = Some(RayHit { distance, triangle_idx, surface: triangle.surface });
            }
        }
        best
    }

    /// In how many solids `point` lies: 0 in the open. For closed solids, which may overlap.
    ///
    /// Counts the faces that a ray to the sky leaves and enters through; of three rays, the median counts, since one
    /// may graze an edge or meet two faces that coincide.
    pub fn solid_depth_at(&self, point: Vec3) -> u32 {
        let tilts = [Vec3::new(0.017_3, 1.0, 0.020_1), Vec3::new(-0.151, 1.0, 0.083), Vec3::new(0.061, 1.0, -0.217)];
        let mut depths = tilts.map(|tilt| self.faces_left(point, tilt.normalize()));
        depths.sort_unstable();
        depths[1].max(0) as u32
    }

    /// Solid faces that a ray leaves through, less those that it enters through.
    fn faces_left(&self, mut origin: Vec3, direction: Vec3) -> i32 {
        let mut count = 0;
        while let Some(hit) = self.cast_ray(origin, direction, f32::MAX) {
            let triangle = &self.triangles[hit.triangle_idx as usize];
            if triangle.surface.is_solid() {
                count += if triangle.normal.dot(direction) > 0.0 { 1 } else { -1 };
            }
            origin += direction * (hit.distance + 1.0e-3);
        }
        count
    }

    /// Distance along the ray at which it enters the grid's box; `None` if it misses.
    fn enter(&self, origin: Vec3, direction: Vec3) -> Option<f32> {
        let size = Vec3::new(self.counts[0] as f32, self.counts[1] as f32, self.counts[2] as f32) * CELL_M;
        if origin.cmpge(Vec3::ZERO).all() && origin.cmple(size).all() {
            return Some(0.0);
        }
        let (mut near, mut far) = (0.0f32, f32::INFINITY);
        for axis in 0..3 {
            let (o, d) = (origin[axis], direction[axis]);
            let high = size[axis];
            if d == 0.0 {
                if o < 0.0 || o > high {
                    return None;
                }
                continue;
            }
            let (t0, t1) = (-o / d, (high - o) / d);
            near = near.max(t0.min(t1));
            far = far.min(t0.max(t1));
        }
        (near <= far).then_some(near)
    }

    /// Fills `found` with the solid triangles whose bounds touch the box; a triangle may appear twice.
    pub fn gather_solids(&self, low: Vec3, high: Vec3, found: &mut Vec<u32>) {
        found.clear();
        let (from, to) = self.clamped_cells(low, high);
        for z in from[2]..=to[2] {
            for y in from[1]..=to[1] {
                let row = self.cell_idx([0, y, z]);
                for entry in &self.cells[row + from[0] as usize..=row + to[0] as usize] {
                    if entry & EMPTY != 0 {
                        continue;
                    }
                    for &triangle_idx in self.items_of(*entry as usize) {
                        let triangle = &self.triangles[triangle_idx as usize];
                        let (t_low, t_high) = triangle.bounds();
                        if triangle.surface.is_solid()
                            && t_low.cmple(high).all()
                            && t_high.cmpge(low).all()
                            && !found.contains(&triangle_idx)
                        {
                            found.push(triangle_idx);
                        }
                    }
                }
            }
        }
    }
}
