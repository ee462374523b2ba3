//! Collisions of NPCs with each other and with players: those that overlap are pushed apart, but never off a ledge, and go around each
//! other.

use crate::Vec3;
use crate::cells::CellKey;
use crate::character::{CharacterProfile, MoveScratch};
use crate::float::hypot;
use crate::map::{Liquid, Map};
use crate::navigable::DOWN;
use crate::npc::{Npc, WorldConfig};
use crate::player::{Player, PlayerContact};

/// Side of a cell of the grid that finds neighbours, m; bodies further apart than this never touch.
const CELL_M: f32 = 2.0;
/// Longest push of a body in one tick, m.
const MAX_PUSH_M: f32 = 0.15;
/// Speed at which a body goes around another, m/s, what it gains of it in a tick, and how far aside there must be ground, m.
const ASIDE_SPEED: f32 = 2.0;
const ASIDE_SPEED_PER_TICK: f32 = 0.5;
const ASIDE_M: f32 = 0.3;
/// Least cosine of the angle between the ways of two NPCs that go in the same direction.
const SAME_WAY: f32 = 0.3;
/// Height above the feet from which the ground ahead of a push is looked for, m, and how far below the feet it may lie.
const KNEE_M: f32 = 0.5;
const MAX_DROP_M: f32 = 1.0;

/// Buffers of the neighbour search, reused from tick to tick.
#[derive(Debug, Default)]
pub(crate) struct CrowdScratch {
    /// All bodies that get in the way, by cell and slot.
    bodies: Vec<Listed>,
    /// Push of the NPC in each slot, m, and whether it goes around what it ran into.
    pushes: Vec<(Vec3, bool)>,
}

/// What the neighbour search needs of a body.
#[derive(Debug, Clone, Copy)]
struct Listed {
    cell: CellKey,
    slot: u32,
    feet: Vec3,
    radius: f32,
    height: f32,
    /// Velocity, m/s, and contact of a player, whose slot is beyond those of all NPCs; `None`: it is an NPC.
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

    /// Overlap of this body with `other`, m, in the direction that leads away from it; the opposite is that of the other. Bodies in the
    /// same place separate along x.
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
        let distance = hypot(offset.x, offset.z);
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
    /// Pushes apart all bodies that overlap, each NPC by half of the overlap, along the ground, and stops them from running on into each
    /// other.
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
        // The first body of the next column that may be near; it never goes back.
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
                if !npc.body.is_grounded() || is_safe(map, npc.body.feet, push, profile) {
                    npc.body.shove(map.mesh(), profile, push, scratch);
                }
                block(npc, map, profile, away, *goes_around);
            }
        }
    }
}

/// Adds to the pushes of two bodies the share that each takes of their overlap, which leads from the second to the first.
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

/// Whether two NPCs are on their way in about the same direction: then the one waits behind the other instead of going around it.
fn go_the_same_way(npcs: &[Option<Npc>], one: &Listed, other: &Listed) -> bool {
    let way = |body: &Listed| {
        let episode = npcs[body.slot as usize].as_ref()?.episode.filter(|episode| episode.end.is_none())?;
        let offset = episode.goal - body.feet;
        Vec3::new(offset.x, 0.0, offset.z).try_normalize()
    };
    way(one).zip(way(other)).is_some_and(|(one, other)| one.dot(other) > SAME_WAY)
}

/// The share of its overlap with a player by which an NPC gives way: all of it to one that pushes; otherwise the share that came about by
/// its own motion.
fn yields(npcs: &[Option<Npc>], npc: &Listed, overlap: Vec3, (velocity, contact): (Vec3, PlayerContact)) -> f32 {
    if contact == PlayerContact::Push {
        return 1.0;
    }
    let away = overlap.normalize_or_zero();
    let own = npcs[npc.slot as usize].as_ref().map_or(0.0, |npc| -npc.body.velocity.dot(away)).max(0.0);
    let players = velocity.dot(away).max(0.0);
    if own > 0.0 { own / (own + players) } else { 0.0 }
}

/// Stops a body from going on towards another that it has run into, and lets one that stands on the ground go around it if it is to: on the
/// right, or on the left where there is no ground, so that those that meet head-on pass each other.
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

/// Whether a body that stands at `feet` still does after a push, so that nobody is pushed off a ledge or into lava.
fn is_safe(map: &Map, feet: Vec3, push: Vec3, profile: &CharacterProfile) -> bool {
    // The edge of the body may hang over.
    let length = push.length();
    let ahead = feet + push * ((length + profile.radius) / length);
    let from = ahead + Vec3::Y * KNEE_M;
    let below = map.mesh().cast_ray(from, DOWN, KNEE_M + MAX_DROP_M);
    below.is_some_and(|hit| hit.surface.is_solid() && map.liquid_at(ahead, 0.0) != Some(Liquid::Lava))
}
