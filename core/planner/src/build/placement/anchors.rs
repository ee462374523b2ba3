//! Places vertices beside devices and movers: one at each end of every pad, zip line and teleporter, one on each side
//! of every door, and some around each stop of every lift.

use crate::grid::GrowingGrid;
use surefoot_world::character::MoveScratch;
use surefoot_world::crossings::crossings;
use surefoot_world::map::{DeviceKind, MoverKind};
use surefoot_world::{CharacterProfile, Map, Vec3, navigable};

/// Greatest horizontal distance of a vertex from its device, m.
const BESIDE_M: f32 = 5.0;
/// Greatest height difference between a vertex and its device, m.
const RISE_M: f32 = 2.5;
/// Greatest horizontal distance of a landing from its pad, m.
const LANDING_M: f32 = 11.0;

/// Returns up to `count` positions to stand at entrances, exits and landings, m, device by device. Any two are more
/// than 2.5 m apart.
pub fn beside_devices(map: &Map, profile: &CharacterProfile, count: usize) -> Vec<Vec3> {
    // Centre, greatest horizontal distance and greatest height difference of each search, m.
    let mut spots: Vec<(Vec3, f32, f32)> = Vec::new();
    let near = |point| (point, BESIDE_M, RISE_M);
    let kinds = [DeviceKind::Teleporter, DeviceKind::ZipLine, DeviceKind::Pad, DeviceKind::Jetpack];
    let kinds = kinds.into_iter().filter(|kind| profile.uses(*kind));
    for device in kinds.flat_map(|kind| map.placed().devices_of(kind)) {
        spots.push(near(device.from));
        match device.kind {
            DeviceKind::Teleporter | DeviceKind::ZipLine => spots.push(near(device.exit())),
            DeviceKind::Pad => {
                // Landings lie around 60 % of the height of the flight, at most as high as its top.
                let height = 0.5 * device.power * device.power / profile.gravity;
                let landing = device.from + Vec3::new(0.0, 0.6 * height, 0.0);
                spots.push((landing, LANDING_M, 0.4 * height));
            }
            DeviceKind::Jetpack => {}
        }
    }
    spots.extend(spread(&crossings(map, profile)).flat_map(|crossing| [near(crossing.from), near(crossing.to)]));
    spots.extend(beside_movers(map));
    let mut scratch = MoveScratch::default();
    let apart = 0.5 * BESIDE_M;
    let mut anchors = GrowingGrid::new(map.extent(), apart, &[]);
    for (point, reach, rise) in spots {
        if anchors.points().len() == count {
            break;
        }
        let Some(feet) = navigable::stand_near(map, profile, point, reach, rise, &mut scratch) else { continue };
        if anchors.within(feet, apart).all(|(_, other)| other.distance(feet) > apart) {
            anchors.push(feet);
        }
    }
    anchors.points().to_vec()
}

/// All of `items`, in an order in which those that follow one another lie far apart in `items`, so that the first few
/// are a sample of all.
fn spread<T>(items: &[T]) -> impl Iterator<Item = &T> {
    let is_coprime = |step: &usize| gcd(*step, items.len()) == 1;
    // Near the golden section, which spreads any number of them evenly.
    let step = (items.len() * 382 / 1000..).find(is_coprime).unwrap_or(1);
    (0..items.len()).map(move |idx| &items[idx * step % items.len()])
}

fn gcd(a: usize, b: usize) -> usize {
    if b == 0 { a } else { gcd(b, a % b) }
}

/// Distance from a mover at which an NPC waits for it, m.
const WAIT_M: f32 = 1.3;
/// Greatest horizontal distance of a vertex from there, m.
const WAIT_REACH_M: f32 = 1.2;
/// Greatest height difference between a vertex and there, m.
const WAIT_RISE_M: f32 = 1.0;

/// Positions on both sides of doors, and around the stops of lifts and platforms: centre, and greatest distances of
/// each search, m.
fn beside_movers(map: &Map) -> Vec<(Vec3, f32, f32)> {
    let mut spots = Vec::new();
    for mover in map.movers() {
        let stops = match mover.kind {
            MoverKind::Door => 0..1,
            MoverKind::Lift | MoverKind::Platform => 0..mover.stops.len(),
            MoverKind::Floor | MoverKind::Conveyor | MoverKind::Crate => continue,
        };
        for stop in stops {
            let (low, high) = mover.bounds_at(stop);
            let (middle, half) = ((low + high) * 0.5, (high - low) * 0.5);
            let level = if mover.kind == MoverKind::Door { low.y } else { high.y };
            let aside = [Vec3::X, Vec3::NEG_X, Vec3::Z, Vec3::NEG_Z].into_iter().filter(|side| {
                // A door has vertices only in front of it and behind it.
                mover.kind != MoverKind::Door || (half.x < half.z) == (side.x != 0.0)
            });
            spots.extend(aside.map(|side| {
                let at = Vec3::new(middle.x, level, middle.z) + side * (half.dot(side.abs()) + WAIT_M);
                (at, WAIT_REACH_M, WAIT_RISE_M)
            }));
        }
    }
    spots
}
