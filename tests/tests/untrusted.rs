//! Untrusted bytes: every decoder returns a value or an error with a message, and takes memory in proportion to the
//! input. The trials are those of the fuzz targets. The inputs are their corpora, unchanged and mutated.

use crate::decoders::{FIRST_NPC, TRIALS, Trial, answer};
use proptest::prelude::*;
use proptest::test_runner::{RngSeed, TestRunner};
use std::collections::BTreeSet;
use std::path::Path;
use surefoot_proto::{convert, world::v1 as wire};

/// Number of inputs for each decoder.
const CASES: u32 = 100_000;
/// Most bytes of noise in an input.
const NOISE_LEN: u32 = 300;

/// The corpus of a fuzz target.
fn corpus(name: &str) -> Vec<Vec<u8>> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tools/fuzz/corpus").join(name);
    let mut files: Vec<_> = std::fs::read_dir(&folder)
        .unwrap_or_else(|error| panic!("{}: {error}", folder.display()))
        .map(|entry| entry.expect("a folder that can be listed").path())
        .collect();
    files.sort();
    assert!(!files.is_empty(), "the corpus of {name} is empty");
    files.iter().map(|file| std::fs::read(file).expect("a file of the checkout")).collect()
}

/// One mutation of an input. Positions are shares of the input's length, in units of 1 / 65,536.
#[derive(Debug, Clone)]
enum Change {
    Flip(u16, u8),
    Byte(u16, u8),
    /// Overwrites bytes with a number, as a length, count or index.
    Number(u16, u64, usize),
    Cut(u16),
    Insert(u16, Vec<u8>),
    /// Overwrites bytes with part of another input of the corpus.
    Graft(u16, usize, u16, u16),
}

impl Change {
    fn apply(&self, bytes: &mut Vec<u8>, corpus: &[Vec<u8>]) {
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
                let other = &corpus[other % corpus.len()];
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
    /// An input of the corpus with mutations.
    Changed(usize, Vec<Change>),
    /// A share of an input's beginning, followed by a number of noise bytes from a seed.
    Noise(usize, u16, u32, u32),
}

impl Input {
    fn bytes(&self, corpus: &[Vec<u8>]) -> Vec<u8> {
        match self {
            Input::Changed(idx, changes) => {
                let mut bytes = corpus[idx % corpus.len()].clone();
                changes.iter().for_each(|change| change.apply(&mut bytes, corpus));
                bytes
            }
            Input::Noise(idx, share, len, seed) => {
                let known = &corpus[idx % corpus.len()];
                let mut bytes = known[..known.len().min(200) * usize::from(*share) / (1 << 16)].to_vec();
                let mut state = *seed;
                bytes.extend((0..*len).map(|_| {
                    // A linear congruential generator, good enough for noise.
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

/// Most memory that a trial of `len` bytes may allocate at a time: for the decoded value, its encoding and decoding,
/// and the trial's own worlds and tables. A decoder that trusts an unchecked count needs far more. Draco's may state up
/// to 512 triangles for each byte.
fn most_memory(name: &str, len: usize) -> u64 {
    if name == "draco" { 64 << 20 } else { (4 << 20) + 16 * len as u64 }
}

fn config() -> ProptestConfig {
    ProptestConfig { cases: CASES, rng_seed: RngSeed::Fixed(1), failure_persistence: None, ..ProptestConfig::default() }
}

fn try_all(name: &str, trial: Trial) {
    let corpus = corpus(name);
    // Memory that a trial allocates once and keeps does not count.
    corpus.iter().for_each(|bytes| trial(bytes));
    let held = TestRunner::new(config()).run(&input(), |input| {
        let bytes = input.bytes(&corpus);
        let used = allocation_counter::measure(|| trial(&bytes)).bytes_max;
        prop_assert!(used <= most_memory(name, bytes.len()), "{} bytes of input take {used} bytes", bytes.len());
        Ok(())
    });
    held.unwrap_or_else(|error| panic!("{name}: {error}"));
}

#[test]
fn every_corpus_input_is_answered() {
    for (name, trial) in TRIALS {
        for bytes in corpus(name) {
            let used = allocation_counter::measure(|| trial(&bytes)).bytes_max;
            assert!(bytes.len() <= 16 * 1024 && used <= (64 << 20), "{name}: {} bytes take {used}", bytes.len());
        }
    }
}

macro_rules! changed_inputs_are_answered {
    ($($trial:ident)*) => {$(
        #[test]
        fn $trial() {
            try_all(stringify!($trial), crate::decoders::$trial);
        }
    )*};
}

changed_inputs_are_answered! {
    world_messages planner_messages map_file gltf meshopt draco obj recording checkpoint cache_entry graph_json
}

/// Numbers that a worker may send, mostly valid ones.
fn number() -> impl Strategy<Value = f32> {
    let odd = vec![f32::NAN, f32::INFINITY, f32::NEG_INFINITY, f32::MAX, f32::MIN, f32::MIN_POSITIVE, -0.0, 1.0e9];
    prop_oneof![30 => -2.0..2.0f32, 1 => prop::sample::select(odd), 1 => any::<u32>().prop_map(f32::from_bits)]
}

/// Ids of the worker's own NPCs, of another worker's, and of none.
fn npc() -> impl Strategy<Value = u64> {
    prop_oneof![8 => FIRST_NPC..FIRST_NPC + 3, 1 => any::<u64>()]
}

/// The attempt that is under way, or another.
fn attempt() -> impl Strategy<Value = u32> {
    prop_oneof![4 => Just(1), 1 => any::<u32>()]
}

fn plan() -> impl Strategy<Value = wire::NpcPlan> {
    let point = (number(), number(), number()).prop_map(|(x, y, z)| wire::Vec3 { x, y, z });
    let leg = (number(), number(), any::<i32>()).prop_map(|(seconds, chance, ability)| wire::PlanLeg {
        seconds,
        chance,
        ability,
    });
    (prop::collection::vec(point, 0..3), prop::collection::vec(leg, 0..3)).prop_map(|(waypoints, legs)| wire::NpcPlan {
        waypoints,
        legs,
        ..Default::default()
    })
}

fn action_batch() -> impl Strategy<Value = wire::ActionBatch> {
    let position = prop::option::weighted(0.95, (number(), number(), number()));
    let waypoint = (npc(), position, attempt(), any::<bool>()).prop_map(|(npc_id, position, attempt, stands)| {
        wire::Waypoint { npc_id, position: position.map(|(x, y, z)| wire::Vec3 { x, y, z }), attempt, stands }
    });
    let carried = (npc(), prop::option::weighted(0.95, plan()), attempt())
        .prop_map(|(npc_id, plan, attempt)| wire::CarriedPlan { npc_id, plan, attempt });
    let given_up = (npc(), attempt(), any::<bool>()).prop_map(|(npc_id, attempt, unreachable)| wire::GivenUp {
        npc_id,
        attempt,
        unreachable,
    });
    let prediction = (npc(), attempt(), prop::collection::vec(number(), 0..14), any::<u32>(), -1..9i32).prop_map(
        |(npc_id, attempt, poses, take_off_ticks, take_off_ability)| {
            let poses = convert::pack(poses);
            wire::CarriedPrediction { npc_id, attempt, poses, take_off_ticks, take_off_ability }
        },
    );
    let tick = prop_oneof![4 => Just(0), 1 => any::<u64>()];
    let row = prop::collection::vec((npc(), [number(), number(), number(), number()], attempt(), any::<u8>()), 0..4);
    let missing = prop_oneof![6 => Just(0usize), 1 => 1..20usize];
    let lists = (
        prop::collection::vec(waypoint, 0..3),
        prop::collection::vec(given_up, 0..3),
        prop::collection::vec(carried, 0..3),
        prop::collection::vec(prediction, 0..3),
    );
    (tick, row, missing, lists).prop_map(|(tick, rows, missing, (waypoints, gave_up, plans, predictions))| {
        let mut actions = convert::pack(rows.iter().flat_map(|(_, row, ..)| *row));
        actions.truncate(actions.len().saturating_sub(missing));
        let npc_ids = rows.iter().map(|(id, ..)| *id).collect();
        let attempts = rows.iter().map(|(_, _, attempt, _)| *attempt).collect();
        let standings = rows.iter().map(|(.., standing)| *standing).collect();
        wire::ActionBatch {
            world_id: 1,
            tick,
            npc_ids,
            actions,
            waypoints,
            gave_up,
            plans,
            attempts,
            standings,
            predictions,
            ..Default::default()
        }
    })
}

proptest! {
    #![proptest_config(config())]

    /// Only the shape of an answer can make all of it unusable. Numbers that are not finite concern their own NPC.
    #[test]
    fn an_answer_of_the_right_shape_is_applied_whatever_its_numbers_and_other_npcs_continue(batch in action_batch()) {
        let ids: BTreeSet<u64> = batch.npc_ids.iter().copied().collect();
        let is_of_shape = ids.len() == batch.npc_ids.len()
            && batch.actions.len() == 16 * ids.len()
            && batch.attempts.len() == ids.len();
        prop_assert_eq!(answer(&batch), is_of_shape);
    }
}
