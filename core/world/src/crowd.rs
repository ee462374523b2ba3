//! Collisions of NPCs with each other and with players. Bodies that overlap are pushed apart, but never off a ledge,
//! and go around each other.

use crate::Vec3;
use crate::cells::CellKey;
use crate::character::{CharacterProfile, MoveScratch};
use crate::float::horizontal;
use crate::map::{Liquid, Map};
use crate::navigable::DOWN;
use crate::npc::{Npc, WorldConfig};
use crate::player::{Player, PlayerContact};

/// Side of a cell, m; bodies farther apart than this never touch.
const CELL_M: f32 = 2.0;
/// Longest push of a body in one tick, m.
const MAX_PUSH_M: f32 = 0.15;
/// Speed at which a body goes around another, m/s, its increase per tick, and the distance at which there must be
/// ground beside it, m.
const ASIDE_SPEED: f32 = 2.0;
const ASIDE_SPEED_PER_TICK: f32 = 0.5;
const ASIDE_M: f32 = 0.3;
/// Smallest cosine of the angle between the directions of two NPCs that go the same way.
const SAME_WAY: f32 = 0.3;
/// How far ahead a body that touches others looks for a ledge, s.
const LOOK_AHEAD_S: f32 = 0.25;
/// The ground ahead of a push is searched from this height above the feet, m, to this depth below them, m.
const KNEE_M: f32 = 0.5;
const MAX_DROP_M: f32 = 1.0;

/// Buffers of the neighbour search, reused from tick to tick.
#[derive(Debug, Default)]
pub(crate) struct CrowdScratch {
    /// All solid bodies, by cell and slot.
    bodies: Vec<Listed>,
    /// Push of the NPC in each slot, m, and whether it goes around the body that it touches.
    pushes: Vec<(Vec3, bool)>,
}

/// A body in the neighbour search.
#[derive(Debug, Clone, Copy)]
struct Listed {
    cell: CellKey,
    slot: u32,
    feet: Vec3,
    radius: f32,
    height: f32,
    /// Velocity, m/s, and contact of a player, whose slot follows those of all NPCs; `None` for an NPC.
    player: Option<(Vec3, PlayerContact)>,
}

impl Listed {
    fn of_npc(npc: &Npc, slot: u32, profiles: &[CharacterProfile]) -> Self {
        let profile = &profiles[usize::from(npc.profile.0)];
        Self::new(slot, npc.body.feet, (profile.radius, profile.height), None)
    }

    fn new(slot: u32, feet: Vec3, (radius, height): (f32, f32), player: Option<(Vec3, PlayerContact)>) -> Self {
        let cell = CellKey::at(feet, CELL_M);
        Self { cell, slot, feet, radius, height, player }
    }

    /// Push on this body that would end its overlap with `other`, m; `other` gets the opposite. Bodies in the same
    /// place separate along x.
    fn overlap(&self, other: &Self) -> Option<Vec3> {
        let offset = self.feet - other.feet;
        let reach = self.radius + other.radius;
        if offset.x * offset.x + offset.z * offset.z >= reach * reach {
            return None;
        }
        let clear = if offset.y > 0.0 { other.height } else { self.height };
        if offset.y.abs() >= clear {
            return None;
        }
        let distance = horizontal(offset);
        let away = if distance > 1.0e-4 {
            Vec3::new(offset.x, 0.0, offset.z) / distance
        } else if self.slot < other.slot {
            Vec3::X
        } else {
            -Vec3::X
        };
        Some(away * (reach - distance))
    }
}

impl CrowdScratch {
    /// Pushes overlapping bodies apart along the ground, each NPC by half of the overlap, and stops them from moving
    /// towards each other.
    pub(crate) fn separate<'a>(
        &mut self,
        npcs: &mut [Option<Npc>],
        players: impl Iterator<Item = &'a Player>,
        map: &Map,
        config: &WorldConfig,
        scratch: &mut [MoveScratch],
    ) {
        let profiles = &config.profiles;
        let Self { bodies, pushes } = self;
        bodies.clear();
        bodies.extend(npcs.iter().zip(0..).filter_map(|(npc, slot)| {
            npc.as_ref().filter(|npc| npc.is_solid()).map(|npc| Listed::of_npc(npc, slot, profiles))
        }));
        let solid = players.filter(|player| player.is_solid());
        bodies.extend((npcs.len() as u32..).zip(solid).map(|(slot, player)| {
            let contact = Some((player.velocity, player.contact));
            Listed::new(slot, player.feet, (player.radius, player.height), contact)
        }));
        bodies.sort_unstable_by_key(|body| (body.cell, body.slot));
        pushes.clear();
        pushes.resize(npcs.len(), (Vec3::ZERO, false));
        // The first body of the next column that may be near; it only advances.
        let mut next_column = 0;
        for (idx, body) in bodies.iter().enumerate() {
            let (low, high) = (body.cell.shifted(1, -1), body.cell.shifted(1, 1));
            while next_column < bodies.len() && bodies[next_column].cell < low {
                next_column += 1;
            }
            let beside = bodies[idx + 1..].iter().take_while(|other| other.cell <= body.cell.shifted(0, 1));
            let beyond = bodies[next_column..].iter().take_while(|other| other.cell <= high);
            for other in beside.chain(beyond) {
                if let Some(overlap) = body.overlap(other) {
                    share(npcs, [body, other], overlap, config.npc_collision, pushes);
                }
            }
        }
        for ((npc, (push, goes_around)), scratch) in npcs.iter_mut().zip(pushes).zip(scratch) {
            let length = push.length();
            if let Some(npc) = npc.as_mut().filter(|_| length > 0.0) {
                let profile = &profiles[usize::from(npc.profile.0)];
                let away = *push / length;
                let push = away * length.min(MAX_PUSH_M);
                if is_safe(map, npc.body.feet, push, profile) {
                    npc.body.shove(map.mesh(), profile, push, scratch);
                }
                block(npc, map, profile, away, *goes_around);
                keep_on_ground(npc, map, profile);
            }
        }
    }
}

/// Adds each body's share of the overlap to its push. `overlap` points from the second body to the first.
fn share(
    npcs: &[Option<Npc>],
    [one, other]: [&Listed; 2],
    overlap: Vec3,
    npcs_are_solid: bool,
    pushes: &mut [(Vec3, bool)],
) {
    let mut push = |slot: u32, by: Vec3, goes_around: bool| {
        let (sum, around) = &mut pushes[slot as usize];
        (*sum, *around) = (*sum + by, *around || goes_around);
    };
    match (one.player, other.player) {
        (None, None) if npcs_are_solid => {
            let meet = !go_the_same_way(npcs, one, other);
            push(one.slot, overlap * 0.5, meet);
            push(other.slot, overlap * -0.5, meet);
        }
        (None, Some(player)) => push(one.slot, overlap * yields(npcs, one, overlap, player), true),
        (Some(player), None) => push(other.slot, -overlap * yields(npcs, other, -overlap, player), true),
        _ => {}
    }
}

/// Whether two NPCs go in about the same direction: then one waits behind the other instead of going around it.
fn go_the_same_way(npcs: &[Option<Npc>], one: &Listed, other: &Listed) -> bool {
    let way = |body: &Listed| {
        let episode = npcs[body.slot as usize].as_ref()?.episode.filter(|episode| episode.end.is_none())?;
        let offset = episode.goal - body.feet;
        Vec3::new(offset.x, 0.0, offset.z).try_normalize()
    };
    way(one).zip(way(other)).is_some_and(|(one, other)| one.dot(other) > SAME_WAY)
}

/// Share of the overlap with a player by which an NPC yields: all of it to a player that pushes, otherwise the share
/// that its own motion caused.
fn yields(npcs: &[Option<Npc>], npc: &Listed, overlap: Vec3, (velocity, contact): (Vec3, PlayerContact)) -> f32 {
    if contact == PlayerContact::Push {
        return 1.0;
    }
    let away = overlap.normalize_or_zero();
    let own = npcs[npc.slot as usize].as_ref().map_or(0.0, |npc| -npc.body.velocity.dot(away)).max(0.0);
    let players = velocity.dot(away).max(0.0);
    if own > 0.0 { own / (own + players) } else { 0.0 }
}

/// Stops a body's motion towards another that it touches. On request, a body on the ground also goes around the other:
/// on the right, or on the left if there is no ground, so that bodies that meet head-on pass each other.
fn block(npc: &mut Npc, map: &Map, profile: &CharacterProfile, away: Vec3, goes_around: bool) {
    let towards = -npc.body.velocity.dot(away);
    if towards <= 0.0 {
        return;
    }
    npc.body.velocity += away * towards;
    if !goes_around {
        return;
    }
    let right = Vec3::new(away.z, 0.0, -away.x);
    let is_open = |side: &Vec3| is_safe(map, npc.body.feet, *side * ASIDE_M, profile);
    if let Some(side) = [right, -right].into_iter().find(is_open).filter(|_| npc.body.is_grounded()) {
        let lacking = ASIDE_SPEED - npc.body.velocity.dot(side);
        npc.body.velocity += side * lacking.clamp(0.0, ASIDE_SPEED_PER_TICK);
    }
}

/// Stops a body's motion over a ledge or into lava while it touches others, except the part that it wants itself.
fn keep_on_ground(npc: &mut Npc, map: &Map, profile: &CharacterProfile) {
    let flat = Vec3::new(npc.body.velocity.x, 0.0, npc.body.velocity.z);
    let ahead = flat * LOOK_AHEAD_S;
    if !npc.body.is_grounded() || ahead.length() < 1.0e-3 || is_safe(map, npc.body.feet, ahead, profile) {
        return;
    }
    let wish = npc.body.wish(profile, &npc.action).with_y(0.0).normalize_or_zero();
    let along = wish * flat.dot(wish).max(0.0);
    (npc.body.velocity.x, npc.body.velocity.z) = (along.x, along.z);
}

/// Whether a body at `feet` still stands on safe ground after a push, not over a ledge or in lava.
fn is_safe(map: &Map, feet: Vec3, push: Vec3, profile: &CharacterProfile) -> bool {
    // The rim of the body may overhang.
    let length = push.length();
    let ahead = feet + push * ((length + profile.radius) / length);
    let from = ahead + Vec3::Y * KNEE_M;
    let below = map.mesh().cast_ray(from, DOWN, KNEE_M + MAX_DROP_M);
    below.is_some_and(|hit| hit.surface.is_solid() && map.liquid_at(ahead, 0.0) != Some(Liquid::Lava))
}
