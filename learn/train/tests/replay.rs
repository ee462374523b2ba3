//! The replay buffer: batches for reactive and for recurrent learners.

use rand::SeedableRng;
use rand::rngs::ChaCha8Rng;
use surefoot_policy::config::RAY_LEN;
use surefoot_train::replay::{self, Batch, MEMORY_STRIDE, Replay, RowKind, Sampling, Step};
use surefoot_world::OBSERVATION_LEN;

const DISCOUNT: f32 = 0.5;

/// One lane whose observations have the number of the step as the goal distance.
fn replay(kinds: &[(RowKind, f32)]) -> Replay {
    let mut replay = Replay::new(1, 64);
    for (number, &(kind, reward)) in kinds.iter().enumerate() {
        let mut observation = vec![0.0; OBSERVATION_LEN];
        observation[RAY_LEN] = number as f32;
        replay.push_step(&Step {
            observations: observation,
            actions: vec![[0.5, 0.25, -0.25, 1.0]],
            memory: Vec::new(),
            is_fresh: vec![false],
            rewards: vec![reward],
            kinds: vec![kind],
            version: 0,
        });
    }
    replay
}

/// Step, return, bootstrap factor and step of the next observation of many samples.
fn samples(replay: &Replay, n_step: usize) -> Vec<(u32, f32, f32, u32)> {
    let sampling = Sampling { batch: 200, burn_in: 0, learn: 1, n_step, discount: DISCOUNT, mirror: false };
    let mut batch = Batch::default();
    replay::sample(std::slice::from_ref(replay), sampling, &mut ChaCha8Rng::seed_from_u64(0), &mut batch);
    let step = |rows: &[f32], row: usize| rows[row * OBSERVATION_LEN + RAY_LEN] as u32;
    (0..200)
        .map(|idx| {
            let successor = step(&batch.observations, batch.successors[idx]);
            (step(&batch.observations, idx), batch.returns[idx], batch.bootstrap[idx], successor)
        })
        .collect()
}

#[test]
fn a_terminal_step_has_no_successor_and_a_truncated_one_is_bootstrapped() {
    use RowKind::{Boundary, Continues, Terminated};
    let replay = replay(&[
        (Continues, 1.0),
        (Terminated, 10.0),
        (Continues, 1.0),
        (Continues, 2.0),
        (Boundary, 0.0),
        (Continues, 4.0),
        (Continues, 8.0),
        (Continues, 16.0),
        (Continues, 0.0),
        (Continues, 0.0),
    ]);
    for (step, total, bootstrap, next) in samples(&replay, 2) {
        match step {
            0 => assert_eq!((total, bootstrap), (1.0 + DISCOUNT * 10.0, 0.0), "ends in a terminal state"),
            1 => assert_eq!((total, bootstrap), (10.0, 0.0), "is terminal"),
            2 => assert_eq!(
                (total, bootstrap, next),
                (1.0 + DISCOUNT * 2.0, DISCOUNT * DISCOUNT, 4),
                "two steps to the boundary"
            ),
            3 => assert_eq!(
                (total, bootstrap, next),
                (2.0, DISCOUNT, 4),
                "truncated: the last observation is bootstrapped"
            ),
            4 => panic!("a boundary row has no action"),
            5 => assert_eq!((total, bootstrap, next), (4.0 + DISCOUNT * 8.0, DISCOUNT * DISCOUNT, 7)),
            6 => assert_eq!((total, next), (8.0 + DISCOUNT * 16.0, 8)),
            7 => assert_eq!((total, next), (16.0, 9)),
            other => panic!("step {other} has no full successor yet"),
        }
    }
}

#[test]
fn packed_observations_are_unpacked_to_within_their_resolution() {
    let mut observation = vec![0.0; OBSERVATION_LEN];
    for (idx, value) in observation.iter_mut().enumerate().take(64) {
        *value = idx as f32 / 64.0;
    }
    // A ray on water, one on a pad, one on a teleporter, and a value of the state.
    observation[64 + 5] = 1.0;
    observation[192 + 9] = 1.0;
    observation[256 + 11] = 0.7;
    observation[RAY_LEN + 10] = -0.75;
    let mut replay = Replay::new(1, 8);
    for _ in 0..4 {
        replay.push_step(&Step {
            observations: observation.clone(),
            actions: vec![[0.0; 4]],
            memory: Vec::new(),
            is_fresh: vec![false],
            rewards: vec![0.0],
            kinds: vec![RowKind::Continues],
            version: 0,
        });
    }
    let mut batch = Batch::default();
    let sampling = Sampling { batch: 1, burn_in: 0, learn: 1, n_step: 1, discount: 0.9, mirror: false };
    replay::sample(std::slice::from_ref(&replay), sampling, &mut ChaCha8Rng::seed_from_u64(0), &mut batch);
    for (packed, original) in batch.observations.iter().zip(&observation) {
        assert!((packed - original).abs() < 2.0e-5);
    }
}

/// Two lanes of a recurrent agent: the goal distance is the step, the memory holds the step and the lane.
fn remembering(steps: usize, capacity: usize) -> Replay {
    let mut replay = Replay::new(2, capacity);
    for number in 0..steps {
        let mut observations = vec![0.0; 2 * OBSERVATION_LEN];
        observations[RAY_LEN] = number as f32;
        observations[OBSERVATION_LEN + RAY_LEN] = number as f32;
        replay.push_step(&Step {
            observations,
            actions: vec![[0.1; 4]; 2],
            memory: vec![number as f32, 0.0, number as f32, 1.0],
            is_fresh: vec![number % 7 == 3; 2],
            rewards: vec![1.0; 2],
            // The second lane is truncated at every eleventh step.
            kinds: vec![RowKind::Continues, if number % 11 == 10 { RowKind::Boundary } else { RowKind::Continues }],
            version: 0,
        });
    }
    replay
}

#[test]
fn sequences_start_at_stored_memories_and_include_each_steps_successor() {
    let sampling = Sampling { batch: 64, burn_in: 4, learn: 6, n_step: 3, discount: DISCOUNT, mirror: false };
    // More steps than the capacity, so that the oldest are overwritten.
    let replay = remembering(230, 2 * 160);
    let mut batch = Batch::default();
    replay::sample(std::slice::from_ref(&replay), sampling, &mut ChaCha8Rng::seed_from_u64(1), &mut batch);
    let step = |row: usize| batch.observations[row * OBSERVATION_LEN + RAY_LEN] as u64;
    let (mut lanes, mut boundaries) = ([0, 0], 0);
    for sequence in 0..64 {
        let start = step(sequence);
        assert!(start.is_multiple_of(MEMORY_STRIDE) && (70..=217).contains(&start), "{start}");
        let memory = &batch.memory[2 * sequence..2 * sequence + 2];
        assert_eq!(memory[0] as u64, start, "the memory stored at the start");
        lanes[memory[1] as usize] += 1;
        for idx in 0..13 {
            let at = step(idx * 64 + sequence);
            assert_eq!(at, start + idx as u64, "steps follow each other");
            assert_eq!(batch.keep[idx * 64 + sequence] == 0.0, at % 7 == 3, "memory is reset where it was");
        }
        for idx in 0..6 {
            let row = idx * 64 + sequence;
            let (from, led_to) = (start + 4 + idx as u64, step(batch.successors[row]));
            let is_boundary = |at: u64| memory[1] == 1.0 && at % 11 == 10;
            let expected = (from..from + 3).find(|&at| is_boundary(at)).unwrap_or(from + 3);
            assert_eq!(led_to, expected);
            assert_eq!(batch.bootstrap[row], DISCOUNT.powi((expected - from) as i32));
            assert_eq!(batch.weights[row] == 0.0, is_boundary(from), "nothing is learned at boundaries");
            boundaries += u32::from(is_boundary(from));
        }
    }
    assert!(lanes[0] > 10 && lanes[1] > 10 && boundaries > 3, "{lanes:?}, {boundaries}");
}

#[test]
fn nothing_is_drawn_before_a_whole_sequence_was_written() {
    let sampling = Sampling { batch: 1, burn_in: 4, learn: 6, n_step: 3, discount: DISCOUNT, mirror: false };
    assert!(!replay::can_sample(&[remembering(12, 400)], sampling));
    assert!(replay::can_sample(&[remembering(12, 400), remembering(13, 400)], sampling));
}

#[test]
fn batches_come_from_all_buffers_in_proportion() {
    use RowKind::Continues;
    let buffers = [replay(&[(Continues, 1.0); 8]), replay(&[(Continues, 3.0); 32]), replay(&[(Continues, 9.0)])];
    let sampling = Sampling { batch: 4000, burn_in: 0, learn: 1, n_step: 1, discount: DISCOUNT, mirror: false };
    let mut batch = Batch::default();
    replay::sample(&buffers, sampling, &mut ChaCha8Rng::seed_from_u64(0), &mut batch);
    let count = |reward: f32| batch.returns.iter().filter(|value| **value == reward).count();
    assert!((600..1000).contains(&count(1.0)) && (3000..3400).contains(&count(3.0)), "8 and 32 rows: {}", count(1.0));
    assert_eq!(count(9.0), 0, "a row without a successor is not drawn");
}

#[test]
fn what_follows_a_closed_attempt_is_not_its_successor() {
    use RowKind::{Continues, Terminated};
    let mut closed = replay(&[(Continues, 1.0), (Continues, 2.0)]);
    closed.close();
    let step = |reward| Step {
        observations: vec![0.0; OBSERVATION_LEN],
        actions: vec![[0.0; 4]],
        is_fresh: vec![true],
        rewards: vec![reward],
        kinds: vec![Continues],
        version: 7,
        ..Step::default()
    };
    (0..4).for_each(|_| closed.push_step(&step(100.0)));
    for (number, total, bootstrap, next) in samples(&closed, 3) {
        if number == 0 && next == 1 {
            assert_eq!((total, bootstrap), (1.0, DISCOUNT), "bootstrapped from the last observation before the end");
        } else {
            assert!(total >= 100.0, "the row whose successor is unknown is not learned from: {total}");
        }
    }
    let census = replay::census(&[closed]);
    assert_eq!((census.rows, census.continues, census.boundaries, census.twins), (6, 5, 1, 3));
    assert_eq!(census.versions, (0, 7));
    let mut ended = replay(&[(Continues, 1.0), (Terminated, 5.0)]);
    ended.close();
    assert_eq!(replay::census(&[ended]).terminated, 1, "an attempt that has ended stays so");
}

#[test]
fn rows_in_messages_are_the_rows_that_were_sent() {
    let mut observation: Vec<f32> = (0..OBSERVATION_LEN).map(|idx| (idx % 13) as f32 / 13.0).collect();
    // A surface in one channel at most, as sensing writes them.
    observation[64..RAY_LEN].fill(0.0);
    let step = Step {
        observations: [observation.clone(), observation].concat(),
        actions: vec![[0.5, -0.25, 0.125, 1.0], [0.0; 4]],
        is_fresh: vec![true, false],
        rewards: vec![1.5, -0.5],
        kinds: vec![RowKind::Terminated, RowKind::Boundary],
        ..Step::default()
    };
    let bytes = replay::rows_to_bytes(&step);
    assert_eq!(bytes.len(), 2 * 410);
    let read = replay::rows_from_bytes(&bytes, 2).expect("what was just written");
    assert_eq!((read.actions, read.rewards, read.kinds), (step.actions, step.rewards, step.kinds));
    assert_eq!(read.is_fresh, step.is_fresh);
    let far = read.observations.iter().zip(&step.observations).filter(|(read, sent)| (**read - **sent).abs() > 2.0e-5);
    assert_eq!(far.count(), 0);
    let refusal = |bytes: &[u8]| replay::rows_from_bytes(bytes, 2).unwrap_err().to_string();
    assert!(refusal(&bytes[..819]).contains("819 bytes, expected 410 for each of 2 NPCs"));
    for (at, value, words) in
        [(130, 250, "npc 0 has an unknown surface"), (408, 3, "an unknown kind"), (811, 127, "npc 1")]
    {
        let mut bad = bytes.clone();
        bad[at] = value;
        if at == 811 {
            // The last byte but one of a float: an infinite reward.
            bad[410 + 404..410 + 408].copy_from_slice(&f32::INFINITY.to_le_bytes());
        }
        assert!(refusal(&bad).contains(words), "{}", refusal(&bad));
    }
}
