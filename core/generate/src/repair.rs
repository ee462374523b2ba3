//! Places the devices that need a survey of the ground: zip lines and teleporters between islands, and a pad or a zip
//! line for each island without an entrance or exit.

use crate::stage::{Stage, count_on, pad};
use rand::RngExt;
use rand::rngs::ChaCha8Rng;
use surefoot_world::Vec3;
use surefoot_world::character::{CharacterProfile, MoveScratch, is_clear};
use surefoot_world::float::hypot;
use surefoot_world::map::{
    CATCH_HEIGHT_M, CollisionMap, DISC_RADIUS_M, Device, DeviceKind, MapKind, MapSpec, Pad, Placed, ZipLine,
};
use surefoot_world::reach::ground::{Cell, Ground};
use surefoot_world::reach::leap::{self, Leap};
use surefoot_world::reach::{Link, Means, Reach, links};

/// Number of zip lines and of teleporters on the default map at density 1.
const ZIP_LINE_COUNT: f32 = 8.0;
const TELEPORTER_COUNT: f32 = 4.0;
/// Horizontal length of a zip line, m.
const ZIP_LENGTH_M: std::ops::Range<f32> = 15.0..75.0;
/// Fall of a zip line as a share of its horizontal length.
const ZIP_FALL: std::ops::Range<f32> = 0.1..0.7;
/// Smallest distance that a teleporter covers, m.
const TELEPORT_LENGTH_M: f32 = 60.0;
/// Share of all ground that must be mutually reachable before a repair stops early.
const CONNECTED_SHARE: f64 = 0.988;
/// Islands with fewer cells are not repaired.
const MIN_CELLS: u32 = 3;
/// Rounds of one repair, without a new survey in between.
const MAX_ROUNDS: usize = 8;
/// Share of connected ground at which a repaired map is accepted.
const ACCEPTED_SHARE: f64 = 0.975;
/// Most repairs; each starts with a survey of the result of the one before.
const MAX_PASSES: usize = 4;
/// Places that are tried for one device.
const SITE_TRIES: usize = 40;

/// Adds the devices that need a survey, repairs the map, and indexes it again with the discs of all devices.
pub(crate) fn connect(
    bare: CollisionMap,
    spec: &MapSpec,
    rng: &mut ChaCha8Rng,
    thread_count: usize,
    progress: &mut impl FnMut(Stage),
) -> CollisionMap {
    // What a seed generates does not depend on the default body.
    let profile = CharacterProfile::of_paper();
    let mut map = bare;
    let wanted = &spec.features;
    // Pads and zip lines would do away with the need for moves.
    let is_course = MapKind::COURSES.contains(&spec.kind);
    if is_course || !spec.repair && wanted.zip_lines == 0.0 && wanted.teleporters == 0.0 {
        let placed = map.placed().clone();
        return map.with_placed(placed);
    }
    progress(Stage::Survey);
    for pass in 0..MAX_PASSES {
        let reach = Reach::survey_for_repair(&map, &profile, thread_count);
        if pass == 0 {
            progress(Stage::Repair);
        }
        let placed = map.placed().clone();
        let mut repair = Repair { map: &map, profile: &profile, reach, placed, scratch: MoveScratch::default() };
        let has_ground = !repair.ground().cells().is_empty();
        if pass == 0 && has_ground {
            repair.add_zip_lines(count_on(spec, ZIP_LINE_COUNT, spec.features.zip_lines), rng);
            repair.add_teleporters(count_on(spec, TELEPORTER_COUNT, spec.features.teleporters), rng);
        }
        // New devices cut into ground that was connected, so the result of a repair is surveyed again.
        if pass > 0 && repair.connected_share() >= ACCEPTED_SHARE {
            break;
        }
        if has_ground && spec.repair {
            repair.connect_islands(spec);
        }
        let Repair { placed, .. } = repair;
        if pass > 0 && placed == *map.placed() {
            break;
        }
        map = map.with_placed(placed);
        if !spec.repair {
            break;
        }
    }
    map
}

/// Direction of the connection that a cut-off island lacks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Direction {
    In,
    Out,
}

impl Direction {
    /// Start and end of a device between a cell of the island and one of connected ground.
    fn ends<'c>(self, own: &'c Cell, other: &'c Cell) -> (&'c Cell, &'c Cell) {
        match self {
            Direction::In => (other, own),
            Direction::Out => (own, other),
        }
    }
}

struct Repair<'a> {
    map: &'a CollisionMap,
    profile: &'a CharacterProfile,
    reach: Reach,
    placed: Placed,
    scratch: MoveScratch,
}

impl Repair<'_> {
    fn ground(&self) -> &Ground {
        &self.reach.ground
    }

    /// Share of all ground that belongs to the largest region, whose places can all reach one another.
    fn connected_share(&self) -> f64 {
        let regions = self.reach.regions(|_| true);
        let main = regions.cell_counts.iter().max().copied().unwrap_or(0);
        main as f64 / self.ground().cells().len().max(1) as f64
    }

    fn random_cell(&self, rng: &mut ChaCha8Rng) -> Cell {
        let cells = self.ground().cells();
        cells[rng.random_range(0..cells.len())]
    }

    /// Whether a device's disc fits on the ground around `feet`: the ground is level and clear of other devices and of
    /// pools.
    fn is_site(&self, feet: Vec3) -> bool {
        let (column, row) = self.ground().column_of(feet);
        let is_level = [(1, 0), (-1, 0), (0, 1), (0, -1)].iter().all(|&(dx, dz)| {
            let cells = &self.ground().cells()[self.ground().column(column + dx, row + dz)];
            cells.iter().any(|cell| (cell.feet.y - feet.y).abs() < 0.55)
        });
        let mut discs = self.placed.devices().flat_map(Device::ends);
        is_level && discs.all(|disc| disc.distance(feet) > 2.0 * DISC_RADIUS_M + 1.0)
    }

    /// Links the cells `takeoffs` to the cell at `landing`.
    fn link(&mut self, takeoffs: &[u32], landing: Vec3, means: Means) {
        let landing = self.ground().index_at(landing).expect("a cell's place is on the ground") as u32;
        let links: Vec<Link> = links::between(self.ground(), takeoffs, landing, means).collect();
        self.reach.links.extend(links);
    }

    /// Adds up to `count` zip lines from high ground to other islands below.
    fn add_zip_lines(&mut self, count: usize, rng: &mut ChaCha8Rng) {
        for _ in 0..count {
            for _ in 0..SITE_TRIES * 5 {
                let from = self.random_cell(rng);
                let (sin, cos) = libm::sincosf(rng.random_range(0.0..std::f32::consts::TAU));
                let run = rng.random_range(ZIP_LENGTH_M);
                let (column, row) = self.ground().column_of(from.feet + Vec3::new(sin, 0.0, cos) * run);
                let Some(to_idx) = self.ground().column(column, row).next() else { continue };
                let to = self.ground().cells()[to_idx];
                if from.island != to.island && self.try_zip_line(&from, &to) {
                    break;
                }
            }
        }
    }

    /// Adds a zip line between two cells if it fits; true if it does.
    fn try_zip_line(&mut self, from: &Cell, to: &Cell) -> bool {
        let line = ZipLine { from: from.feet, to: to.feet };
        let run = hypot(to.feet.x - from.feet.x, to.feet.z - from.feet.z);
        let fall = (from.feet.y - to.feet.y) / run.max(0.1);
        if !ZIP_LENGTH_M.contains(&run) || !ZIP_FALL.contains(&fall) {
            return false;
        }
        if !self.is_site(from.feet) || !self.is_site(to.feet) || !self.is_path_clear(&line) {
            return false;
        }
        self.placed.zip_lines.push(line);
        let takeoffs = links::cells_beside(self.ground(), from.feet);
        self.link(&takeoffs, to.feet, Means::ZipLine);
        true
    }

    /// Whether a body that rides the line touches nothing.
    fn is_path_clear(&mut self, line: &ZipLine) -> bool {
        const STEP_M: f32 = 0.4;
        let steps = (line.length() / STEP_M) as usize;
        (1..=steps).all(|step| {
            let (feet, _) = line.at(step as f32 * STEP_M);
            is_clear(self.map.mesh(), self.profile, feet, 0.0, &mut self.scratch)
        })
    }

    fn add_teleporters(&mut self, count: usize, rng: &mut ChaCha8Rng) {
        for nth in 0..count {
            for _ in 0..SITE_TRIES {
                let (from, to) = (self.random_cell(rng), self.random_cell(rng));
                let is_far = from.feet.distance(to.feet) > TELEPORT_LENGTH_M;
                if !is_far || from.island == to.island || !self.is_site(from.feet) || !self.is_site(to.feet) {
                    continue;
                }
                let one_way = Device::new(DeviceKind::Teleporter, from.feet);
                let teleporter = Device { to: Some(to.feet), two_way: nth % 2 == 1, ..one_way };
                self.placed.add(teleporter);
                self.reach.links.extend(links::by_teleporter(&self.reach.ground, teleporter));
                break;
            }
        }
    }

    /// Adds a pad or a zip line for each island without a way in or out, the largest first, until enough ground is
    /// connected.
    fn connect_islands(&mut self, spec: &MapSpec) {
        let cells_of = cells_by_island(self.ground());
        for _ in 0..MAX_ROUNDS {
            let regions = self.reach.regions(|_| true);
            let main = regions.largest();
            let (reached, reaching) = (regions.reachable_from(main), regions.reaching(main));
            let mut is_main: Vec<bool> = regions.of_island.iter().map(|&region| region == main).collect();
            let total = self.ground().cells().len() as f64;
            if regions.cell_counts[main as usize] as f64 >= CONNECTED_SHARE * total {
                return;
            }
            let mut done = true;
            for island in 0..is_main.len() {
                let region = regions.of_island[island];
                if is_main[island] || (cells_of[island].len() as u32) < MIN_CELLS {
                    continue;
                }
                let had_entrance = reached[region as usize];
                let had_exit = reaching[region as usize];
                let has_entrance = had_entrance || self.add_device(spec, &cells_of[island], &is_main, Direction::In);
                let has_exit = had_exit || self.add_device(spec, &cells_of[island], &is_main, Direction::Out);
                done &= had_entrance == has_entrance && had_exit == has_exit;
                if has_entrance && has_exit {
                    is_main[island] = true;
                }
            }
            if done {
                return;
            }
        }
    }

    /// Adds a device that leads from connected ground to `cells`, or from `cells` to connected ground; false if none
    /// fits.
    fn add_device(&mut self, spec: &MapSpec, cells: &[Cell], is_main: &[bool], direction: Direction) -> bool {
        if spec.features.pads > 0.0 {
            let own_count = if direction == Direction::In { 6 } else { 8 };
            for own in spread(cells, own_count) {
                for other in self.cells_around(own.feet, is_main).into_iter().take(SITE_TRIES) {
                    let (site, target) = direction.ends(&own, &other);
                    if self.try_pad(site, target) {
                        return true;
                    }
                }
            }
        }
        spec.features.zip_lines > 0.0 && self.zip_line_between(cells, is_main, direction)
    }

    /// A sparse selection of connected cells within reach of a pad, the nearest first.
    fn cells_around(&self, centre: Vec3, is_main: &[bool]) -> Vec<Cell> {
        let ground = self.ground();
        let (column, row) = ground.column_of(centre);
        let mut found: Vec<(f32, Cell)> = Vec::new();
        for z in (row - 12..=row + 12).step_by(2) {
            for x in (column - 12..=column + 12).step_by(2) {
                for cell in &ground.cells()[ground.column(x, z)] {
                    let distance = hypot(cell.feet.x - centre.x, cell.feet.z - centre.z);
                    if is_main[cell.island as usize] && (2.5..14.0).contains(&distance) {
                        found.push((distance, *cell));
                    }
                }
            }
        }
        found.sort_by(|a, b| a.0.total_cmp(&b.0));
        found.into_iter().map(|(_, cell)| cell).collect()
    }

    /// Adds a pad at `site` if the pad throws a body onto the island of `target`; true if it does.
    fn try_pad(&mut self, site: &Cell, target: &Cell) -> bool {
        let rise = target.feet.y - site.feet.y;
        if rise > 24.0 || !self.is_site(site.feet) {
            return false;
        }
        let Pad { speed, .. } = pad(site.feet, (rise - 6.0).max(-4.0));
        let landed = leap::land(self.map, self.profile, site.feet, target.feet, Leap::Pad(speed), &mut self.scratch);
        let island = landed.and_then(|feet| self.ground().at(feet)).map(|cell| cell.island);
        if island != Some(target.island) {
            return false;
        }
        let centre = site.feet - Vec3::new(0.0, 0.1 * CATCH_HEIGHT_M, 0.0);
        self.placed.pads.push(Pad { centre, speed });
        let takeoff = self.ground().index_at(site.feet).expect("a cell's place is on the ground") as u32;
        self.link(&[takeoff], target.feet, Means::Pad);
        true
    }

    /// Adds a zip line between `cells` and connected ground; false if none fits.
    fn zip_line_between(&mut self, cells: &[Cell], is_main: &[bool], direction: Direction) -> bool {
        let main: Vec<Cell> = {
            let cells = self.ground().cells();
            let near = |cell: &&Cell| is_main[cell.island as usize];
            cells.iter().filter(near).step_by(17).copied().collect()
        };
        for own in spread(cells, 4) {
            let mut tries = 0;
            for other in &main {
                if own.feet.distance_squared(other.feet) > ZIP_LENGTH_M.end * ZIP_LENGTH_M.end {
                    continue;
                }
                let (from, to) = direction.ends(&own, other);
                tries += 1;
                if self.try_zip_line(from, to) {
                    return true;
                }
                if tries > 400 {
                    break;
                }
            }
        }
        false
    }
}

/// Up to `count` cells, spread evenly over the list.
fn spread(cells: &[Cell], count: usize) -> Vec<Cell> {
    let step = cells.len().div_ceil(count).max(1);
    cells.iter().skip(step / 2).step_by(step).copied().collect()
}

fn cells_by_island(ground: &Ground) -> Vec<Vec<Cell>> {
    let mut by_island = vec![Vec::new(); ground.islands().len()];
    ground.cells().iter().for_each(|cell| by_island[cell.island as usize].push(*cell));
    by_island
}
