//! Edits of a running world's map: finds the NPCs that a new piece would enclose, and a free place for each.

use crate::Vec3;
use crate::character::{Body, CharacterProfile, MoveScratch, is_clear};
use crate::map::Map;
use crate::navigable;
use crate::npc::NpcSlot;

/// Distances at which free places are tried, m, and the number of directions.
const RINGS_M: [f32; 7] = [0.5, 1.0, 1.5, 2.0, 2.75, 3.5, 4.5];
const SPOKES: u32 = 12;
/// Greatest height of a free place above or below the feet, m.
const RISE_M: f32 = 1.5;
/// Greatest overlap of a body that counts as clear, m: bodies on slopes touch the ground.
const SLOP_M: f32 = 0.06;

/// A new piece would enclose an NPC, and there is no free place nearby.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("NPC {} stands where a piece would be, and there is no free place within 4.5 m: move the NPC first", .0.0)]
pub struct Enclosed(pub NpcSlot);

/// Finds a place for a body that cannot stay where it is on the changed map: `Ok(None)` if it can stay, an error if
/// there is none.
pub(crate) fn place_for(
    map: &Map,
    changed: &[(Vec3, Vec3)],
    profile: &CharacterProfile,
    body: &Body,
    scratch: &mut MoveScratch,
) -> Result<Option<Vec3>, ()> {
    let feet = body.feet;
    let reach = Vec3::new(profile.radius, 0.0, profile.radius);
    let (low, high) = (feet - reach, feet + reach + Vec3::Y * profile.height);
    let touched = changed.iter().filter(|(least, most)| least.cmple(high).all() && most.cmpge(low).all());
    let Some(top) = touched.map(|(_, most)| most.y).reduce(f32::max) else { return Ok(None) };
    let middle = feet + Vec3::Y * (0.5 * profile.height);
    if is_clear(map.mesh(), profile, feet, SLOP_M, scratch) && map.mesh().solid_depth_at(middle) == 0 {
        return Ok(None);
    }
    let turn = |spoke: u32| libm::sincosf(spoke as f32 * std::f32::consts::TAU / SPOKES as f32);
    let beside = RINGS_M.iter().flat_map(|radius| {
        (0..SPOKES).map(move |spoke| {
            let (sin, cos) = turn(spoke);
            feet + Vec3::new(radius * cos, 0.0, radius * sin)
        })
    });
    let beside = beside.map(|place| (place, RISE_M));
    let above = std::iter::once((feet.with_y(top), RISE_M));
    let stand = |(place, rise)| navigable::stand_at(map, profile, place, rise, scratch);
    beside.chain(above).find_map(stand).map(Some).ok_or(())
}
