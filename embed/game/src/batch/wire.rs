//! Layout of the messages: little-endian, packed, every length known before it is read.

use crate::decide::{Acted, Decided, Decision, Sighting, TICKS};
use crate::world::{BodyState, Hit};
use surefoot_world::mesh::Surface;
use surefoot_world::sense::{RAY_COUNT, RAY_RANGE_M, RayCone};
use surefoot_world::{Ability, AbilitySet, Action, Body, CharacterProfile, End, Vec3};

/// Version of the protocol.
const VERSION: u32 = 1;
/// First bytes of a hello.
const MAGIC: u32 = u32::from_le_bytes(*b"SFGW");
/// Ticks in a second.
const TICK_RATE: u32 = 60;
/// Bytes of a state.
const STATE_BYTES: usize = 36;
/// Abilities that a state can name, after walking.
const USED_ABILITIES: u32 = 6;
/// Bytes of what 64 rays hit.
const HITS_BYTES: usize = RAY_COUNT * 5;
/// Surface of a ray that hits nothing.
const NOTHING: u8 = 255;
/// Bytes of the header of a message: its kind, and the bytes that follow.
pub(super) const HEADER_BYTES: usize = 8;
/// Longest text of a refusal, bytes.
pub(super) const MAX_REFUSAL_BYTES: usize = 512;
/// Most places to stand in an answer.
pub(super) const MAX_PLACES: usize = 1000;

/// What a message is; an answer has the kind of its request, or is a refusal.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u32)]
pub(super) enum Kind {
    Refusal = 0,
    Hello = 1,
    Open = 2,
    Places = 3,
    Decide = 4,
}

impl Kind {
    /// Its name in messages to people.
    pub fn name(self) -> &'static str {
        match self {
            Self::Refusal => "refusal",
            Self::Hello => "hello",
            Self::Open => "open",
            Self::Places => "places",
            Self::Decide => "decide",
        }
    }
}

/// A message that is being written.
#[derive(Debug)]
struct Writer(Vec<u8>);

impl Writer {
    fn begin(kind: Kind) -> Self {
        let mut writer = Self(Vec::new());
        writer.int(kind as u32);
        writer.int(0);
        writer
    }

    fn int(&mut self, value: u32) {
        self.0.extend(value.to_le_bytes());
    }

    fn floats(&mut self, values: &[f32]) {
        values.iter().for_each(|value| self.0.extend(value.to_le_bytes()));
    }

    fn finish(mut self) -> Vec<u8> {
        let len = (self.0.len() - HEADER_BYTES) as u32;
        self.0[4..HEADER_BYTES].copy_from_slice(&len.to_le_bytes());
        self.0
    }
}

/// The numbers of a hello, with their names: both sides must have the same.
const HELLO: [(&str, u32); 6] = [
    ("magic", MAGIC),
    ("version", VERSION),
    ("ticks of a decision", TICKS as u32),
    ("ticks of a second", TICK_RATE),
    ("rays", RAY_COUNT as u32),
    ("bytes of a state", STATE_BYTES as u32),
];

/// Bytes of the answer to a hello.
pub(super) const HELLO_BYTES: usize = 4 * HELLO.len();

pub(super) fn hello() -> Vec<u8> {
    let mut writer = Writer::begin(Kind::Hello);
    HELLO.iter().for_each(|(_, value)| writer.int(*value));
    writer.finish()
}

/// Checks the answer to a hello.
pub(super) fn read_hello(body: &[u8]) -> Result<(), String> {
    let mut reader = Reader(body);
    for (name, expected) in HELLO {
        match reader.int() {
            found if found == expected => {}
            _ if name == "magic" => return Err("its hello does not begin with SFGW".to_owned()),
            found => return Err(format!("its hello says {found} {name}, expected {expected}")),
        }
    }
    Ok(())
}

/// Asks for a world of `count` characters.
pub(super) fn open(profile: &CharacterProfile, count: usize) -> Vec<u8> {
    let flag = |is_set: bool| if is_set { 1.0 } else { 0.0 };
    let mut writer = Writer::begin(Kind::Open);
    writer.int(count as u32);
    writer.floats(&[
        profile.height,
        profile.radius,
        profile.forward_speed,
        profile.side_speed_share,
        profile.turn_speed,
        profile.jump_speed,
        profile.gravity,
        profile.extra_jumps.into(),
        profile.max_slope,
        profile.step_height,
        profile.ground_acceleration,
        profile.air_acceleration,
        profile.coyote_ticks.into(),
        flag(profile.uses_zip_lines),
        profile.zip_line_speed,
        flag(profile.uses_jetpacks),
        profile.jetpack_acceleration,
        profile.jetpack_climb_speed,
    ]);
    let eye = RayCone::eye(profile, &Body::at(Vec3::ZERO, 0.0));
    writer.floats(&[eye.y, RAY_RANGE_M]);
    RayCone::default().directions().iter().for_each(|direction| writer.floats(&direction.to_array()));
    writer.finish()
}

/// Asks for at most [`MAX_PLACES`] places to stand, drawn with `seed`.
pub(super) fn places(seed: u64) -> Vec<u8> {
    let mut writer = Writer::begin(Kind::Places);
    writer.0.extend(seed.to_le_bytes());
    writer.int(MAX_PLACES as u32);
    writer.finish()
}

/// Reads an answer with places, m.
pub(super) fn read_places(body: &[u8]) -> Result<Vec<Vec3>, String> {
    if !body.len().is_multiple_of(12) {
        return Err(format!("its places have {} bytes, which is no multiple of 12", body.len()));
    }
    let mut reader = Reader(body);
    let places: Vec<Vec3> = (0..body.len() / 12).map(|_| reader.vector()).collect();
    finite(places.iter().all(|place| place.is_finite()), "place", "coordinates")?;
    Ok(places)
}

pub(super) fn decide(Decision { actions, placements }: Decision<'_>) -> Vec<u8> {
    let mut writer = Writer::begin(Kind::Decide);
    writer.int(actions.len() as u32);
    writer.int(placements.len() as u32);
    for (character, action) in actions {
        writer.int(*character as u32);
        writer.floats(&Action::to_array(*action));
    }
    for (character, feet, yaw) in placements {
        writer.int(*character as u32);
        writer.floats(&[feet.x, feet.y, feet.z, *yaw]);
    }
    writer.finish()
}

/// Bytes of the answer to a decision.
pub(super) fn decided_bytes(Decision { actions, placements }: Decision<'_>) -> usize {
    actions.len() * (TICKS * STATE_BYTES + HITS_BYTES) + placements.len() * (STATE_BYTES + HITS_BYTES)
}

/// Reads the answer to a decision, which has [`decided_bytes`].
pub(super) fn read_decided(body: &[u8], Decision { actions, placements }: Decision<'_>) -> Result<Decided, String> {
    let mut reader = Reader(body);
    let mut decided = Decided::default();
    for (character, _) in actions {
        let mut ticks = [BodyState::default(); TICKS];
        for state in &mut ticks {
            *state = reader.state(*character)?;
        }
        decided.acted.push(Acted { ticks, hits: reader.hits(*character)? });
    }
    for (character, ..) in placements {
        let state = reader.state(*character)?;
        decided.placed.push(Sighting { state, hits: reader.hits(*character)? });
    }
    Ok(decided)
}

/// A message that is being read, whose length has been checked.
struct Reader<'a>(&'a [u8]);

impl Reader<'_> {
    fn bytes<const N: usize>(&mut self) -> [u8; N] {
        let (bytes, rest) = self.0.split_first_chunk().expect("the length of a message was checked");
        self.0 = rest;
        *bytes
    }

    fn int(&mut self) -> u32 {
        u32::from_le_bytes(self.bytes())
    }

    fn float(&mut self) -> f32 {
        f32::from_le_bytes(self.bytes())
    }

    fn vector(&mut self) -> Vec3 {
        Vec3::new(self.float(), self.float(), self.float())
    }

    fn state(&mut self, character: usize) -> Result<BodyState, String> {
        let (feet, velocity) = (self.vector(), self.vector());
        let (yaw, fuel, flags) = (self.float(), self.float(), self.int());
        let of = |what: &str| format!("{what} of character {character}");
        finite(feet.is_finite() && velocity.is_finite(), &of("state"), "feet or velocity")?;
        finite(yaw.is_finite() && fuel.is_finite(), &of("state"), "yaw or fuel")?;
        let has = |bit: u32| flags & (1 << bit) != 0;
        let harm = match flags >> 16 {
            0 => None,
            1 => Some(End::Fell),
            2 => Some(End::Burnt),
            3 => Some(End::Drowned),
            harm => return Err(format!("the {} has harm {harm}; it must be 0 to 3", of("state"))),
        };
        if flags & 0xc0f0 != 0 {
            return Err(format!("the {} has flags 0x{flags:x}; bits 4 to 7, 14 and 15 must be 0", of("state")));
        }
        let used = (0..USED_ABILITIES).filter(|idx| has(8 + idx));
        let used_abilities: AbilitySet = used.filter_map(|idx| Ability::at(idx as usize + 1)).collect();
        Ok(BodyState {
            feet,
            velocity,
            yaw,
            is_grounded: has(0),
            can_jump: has(1),
            rides: has(2),
            fuel,
            is_in_water: has(3),
            harm,
            used_abilities,
        })
    }

    fn hits(&mut self, character: usize) -> Result<[Hit; RAY_COUNT], String> {
        let distances: [f32; RAY_COUNT] = std::array::from_fn(|_| self.float());
        let mut hits = [None; RAY_COUNT];
        for ((ray, hit), distance) in hits.iter_mut().enumerate().zip(distances) {
            let [surface] = self.bytes();
            if surface == NOTHING {
                continue;
            }
            let of = || format!("ray {ray} of character {character}");
            // To the eyes of NPCs, what can be climbed is ground.
            let known = Surface::ALL.get(usize::from(surface)).copied().filter(|it| *it != Surface::Climb);
            let surface = known.ok_or_else(|| format!("{} hits surface {surface}; it must be 0 to 6 or 255", of()))?;
            if !(0.0..=RAY_RANGE_M).contains(&distance) {
                return Err(format!("{} hits after {distance} m; it must be 0 to {RAY_RANGE_M}", of()));
            }
            *hit = Some((distance, surface));
        }
        Ok(hits)
    }
}

/// Refuses numbers that are not finite.
fn finite(is_finite: bool, whose: &str, what: &str) -> Result<(), String> {
    if is_finite { Ok(()) } else { Err(format!("the {whose} has {what} that are not finite")) }
}
