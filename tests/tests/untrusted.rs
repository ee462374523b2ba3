//! Bytes from outside: whatever they hold, every decoder answers with a value or a message, and takes no more memory than
//! they are worth. The trials are those of the fuzz targets; their kept inputs are tried as they are, and changed.

#[path = "../../fuzz/src/lib.rs"]
mod untrusted;

use proptest::prelude::*;
use proptest::test_runner::{RngSeed, TestRunner};
use std::collections::BTreeSet;
use std::path::Path;
use surefoot_proto::{convert, world::v1 as wire};
use untrusted::{FIRST_NPC, TRIALS, Trial, answer};

/// Inputs that each decoder gets.
const CASES: u32 = 100_000;
/// Longest input made of nothing but noise, bytes.
const NOISE_LEN: u32 = 300;

/// The kept inputs of a fuzz target.
fn kept(name: &str) -> Vec<Vec<u8>> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../fuzz/corpus").join(name);
    let mut files: Vec<_> = std::fs::read_dir(&folder)
        .unwrap_or_else(|error| panic!("{}: {error}", folder.display()))
        .map(|entry| entry.expect("a folder that can be listed").path())
        .collect();
    files.sort();
    assert!(!files.is_empty(), "no inputs are kept for {name}");
    files.iter().map(|file| std::fs::read(file).expect("a file of the checkout")).collect()
}

/// One step from a valid input to an invalid one. Places are shares of the input's length.
#[derive(Debug, Clone)]
enum Change {
    Flip(u16, u8),
    Byte(u16, u8),
    /// A number where a length, count or index may stand.
    Number(u16, u64, usize),
    Cut(u16),
    Insert(u16, Vec<u8>),
    /// A stretch of another kept input.
    Graft(u16, usize, u16, u16),
}

impl Change {
    fn apply(&self, bytes: &mut Vec<u8>, kept: &[Vec<u8>]) {
        let place = |share: u16, len: usize| len * usize::from(share) / (1 << 16);
        let overwrite = |bytes: &mut Vec<u8>, at: usize, new: &[u8]| {
            bytes.iter_mut().skip(at).zip(new).for_each(|(byte, new)| *byte = *new);
        };
        let len = bytes.len();
        match self {
            Change::Flip(at, bit) => bytes.iter_mut().skip(place(*at, len)).take(1).for_each(|byte| *byte ^= 1 << bit),
            Change::Byte(at, value) => overwrite(bytes, place(*at, len), &[*value]),
            Change::Number(at, value, width) => overwrite(bytes, place(*at, len), &value.to_le_bytes()[..*width]),
            Change::Cut(at) => bytes.truncate(place(*at, len)),
            Change::Insert(at, new) => {
                let at = place(*at, len);
                bytes.splice(at..at, new.iter().copied());
            }
            Change::Graft(at, other, from, to) => {
                let other = &kept[other % kept.len()];
                let (from, to) = (place(*from, other.len()), place(*to, other.len()));
                overwrite(bytes, place(*at, len), &other[from.min(to)..from.max(to)]);
            }
        }
    }
}

fn change() -> impl Strategy<Value = Change> {
    let telling = [0, 1, 0x7f, 0x80, 0xff, 0xffff, 1 << 20, 0x7fff_ffff, 0x8000_0000, 0xffff_ffff, 0x7fc0_0000];
    let number = prop_oneof![
        prop::sample::select(telling.to_vec()),
        prop::sample::select(vec![0x7f80_0000, 0x7f7f_ffff, u64::MAX, u64::MAX / 2, 1 << 40]),
        any::<u64>(),
    ];
    prop_oneof![
        3 => (any::<u16>(), 0..8u8).prop_map(|(at, bit)| Change::Flip(at, bit)),
        3 => (any::<u16>(), any::<u8>()).prop_map(|(at, value)| Change::Byte(at, value)),
        3 => (any::<u16>(), number, prop::sample::select(vec![1usize, 2, 4, 8]))
            .prop_map(|(at, value, width)| Change::Number(at, value, width)),
        1 => any::<u16>().prop_map(Change::Cut),
        1 => (any::<u16>(), prop::collection::vec(any::<u8>(), 1..9)).prop_map(|(at, new)| Change::Insert(at, new)),
        1 => (any::<u16>(), 0..64usize, any::<u16>(), any::<u16>())
            .prop_map(|(at, other, from, to)| Change::Graft(at, other, from, to)),
    ]
}

#[derive(Debug, Clone)]
enum Input {
    /// A kept input, changed.
    Changed(usize, Vec<Change>),
    /// The beginning of one, if any, and then so many bytes of noise from a seed.
    Noise(usize, u16, u32, u32),
}

impl Input {
    fn bytes(&self, kept: &[Vec<u8>]) -> Vec<u8> {
        match self {
            Input::Changed(idx, changes) => {
                let mut bytes = kept[idx % kept.len()].clone();
                changes.iter().for_each(|change| change.apply(&mut bytes, kept));
                bytes
            }
            Input::Noise(idx, share, len, seed) => {
                let known = &kept[idx % kept.len()];
                let mut bytes = known[..known.len().min(200) * usize::from(*share) / (1 << 16)].to_vec();
                let mut state = *seed;
                bytes.extend((0..*len).map(|_| {
                    // Knuth's linear congruence: good enough for noise.
                    state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                    (state >> 24) as u8
                }));
                bytes
            }
        }
    }
}

fn input() -> impl Strategy<Value = Input> {
    let changes = prop::collection::vec(change(), 1..6);
    let share = prop_oneof![Just(0), any::<u16>()];
    prop_oneof![
        4 => (0..64usize, changes).prop_map(|(idx, changes)| Input::Changed(idx, changes)),
        1 => (0..64usize, share, 0..NOISE_LEN, any::<u32>())
            .prop_map(|(idx, share, len, seed)| Input::Noise(idx, share, len, seed)),
    ]
}

/// Most memory that a trial of `len` bytes may hold at a time: what comes of the bytes and is written and read again, and
/// the worlds and tables of the trials themselves. A count that is believed before it is checked costs far more.
fn most_memory(len: usize) -> u64 {
    (1 << 20) + 16 * len as u64
}

fn config() -> ProptestConfig {
    ProptestConfig { cases: CASES, rng_seed: RngSeed::Fixed(1), failure_persistence: None, ..ProptestConfig::default() }
}

fn try_all(name: &str, trial: Trial) {
    let kept = kept(name);
    // Whatever the trial makes once and keeps does not count.
    kept.iter().for_each(|bytes| trial(bytes));
    let held = TestRunner::new(config()).run(&input(), |input| {
        let bytes = input.bytes(&kept);
        let used = allocation_counter::measure(|| trial(&bytes)).bytes_max;
        prop_assert!(used <= most_memory(bytes.len()), "{} bytes of input take {used} bytes", bytes.len());
        Ok(())
    });
    held.unwrap_or_else(|error| panic!("{name}: {error}"));
}

#[test]
fn every_kept_input_is_answered() {
    for (name, trial) in TRIALS {
        for bytes in kept(name) {
            let used = allocation_counter::measure(|| trial(&bytes)).bytes_max;
            assert!(bytes.len() <= 16 * 1024 && used <= (64 << 20), "{name}: {} bytes take {used}", bytes.len());
        }
    }
}

macro_rules! changed_inputs_are_answered {
    ($($trial:ident)*) => {$(
        #[test]
        fn $trial() {
            try_all(stringify!($trial), untrusted::$trial);
        }
    )*};
}

changed_inputs_are_answered! {
    world_messages planner_messages map_file gltf obj recording checkpoint cache_entry graph_json
}

/// Numbers that a worker may send: mostly such as can be used.
fn number() -> impl Strategy<Value = f32> {
    let odd = vec![f32::NAN, f32::INFINITY, f32::NEG_INFINITY, f32::MAX, f32::MIN, f32::MIN_POSITIVE, -0.0, 1.0e9];
    prop_oneof![30 => -2.0..2.0f32, 1 => prop::sample::select(odd), 1 => any::<u32>().prop_map(f32::from_bits)]
}

/// NPCs of the worker itself, of another, and none at all.
fn npc() -> impl Strategy<Value = u64> {
    prop_oneof![8 => FIRST_NPC..FIRST_NPC + 3, 1 => any::<u64>()]
}

fn action_batch() -> impl Strategy<Value = wire::ActionBatch> {
    let position = prop::option::weighted(0.95, (number(), number(), number()));
    let waypoint = (npc(), position).prop_map(|(npc_id, position)| wire::Waypoint {
        npc_id,
        position: position.map(|(x, y, z)| wire::Vec3 { x, y, z }),
    });
    let tick = prop_oneof![4 => Just(0), 1 => any::<u64>()];
    let row = prop::collection::vec((npc(), [number(), number(), number(), number()]), 0..4);
    let missing = prop_oneof![6 => Just(0usize), 1 => 1..20usize];
    let lists = (prop::collection::vec(waypoint, 0..3), prop::collection::vec(npc(), 0..3));
    (tick, row, missing, lists).prop_map(|(tick, rows, missing, (waypoints, gave_up))| {
        let mut actions = convert::pack(rows.iter().flat_map(|(_, row)| *row));
        actions.truncate(actions.len().saturating_sub(missing));
        let npc_ids = rows.iter().map(|(id, _)| *id).collect();
        wire::ActionBatch { world_id: 1, tick, npc_ids, actions, waypoints, gave_up, ..Default::default() }
    })
}

proptest! {
    #![proptest_config(config())]

    #[test]
    fn an_answer_is_taken_if_nothing_is_wrong_with_it_and_other_npcs_go_on(batch in action_batch()) {
        let ids: BTreeSet<u64> = batch.npc_ids.iter().copied().collect();
        let is_finite = |bytes: &[u8; 4]| f32::from_le_bytes(*bytes).is_finite();
        let is_place = |place: &wire::Vec3| place.x.is_finite() && place.y.is_finite() && place.z.is_finite();
        let sound = ids.len() == batch.npc_ids.len()
            && batch.actions.len() == 16 * ids.len()
            && batch.actions.as_chunks().0.iter().all(is_finite)
            && batch.waypoints.iter().all(|waypoint| waypoint.position.as_ref().is_some_and(is_place));
        prop_assert_eq!(answer(&batch), sound);
    }
}
