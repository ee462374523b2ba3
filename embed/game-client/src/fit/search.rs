//! Searches the body that moves like the recorded characters: pattern search (Hooke and Jeeves 1961) over a few fields
//! at a time, since the loss has steps where a body does or does not get over a kerb.

use super::{HORIZON, Recording, simulate};
use rayon::prelude::*;
use std::collections::BTreeMap;
use surefoot_world::{CharacterProfile, Map, RawCharacterProfile};

/// Distance up to which the loss is quadratic, m (Huber 1964): beyond, characters have taken different ways.
const NEAR_M: f32 = 0.3;
/// Share of the drifts of each script on open ground that count, the least first (least trimmed squares, Rousseeuw
/// 1984): some controllers catch on the edges between triangles of a floor, for a tick or two.
const KEPT: f64 = 0.5;
/// Jumps in the air that are tried.
const MOST_EXTRA_JUMPS: u8 = 2;
/// A change must lower the loss to this share: what the recordings hardly depend on stays as it is.
const MATERIAL: f64 = 0.98;
/// Halvings of the steps of a search.
const HALVINGS: u32 = 7;
/// Most sweeps over the fields of a search.
const MAX_SWEEPS: u32 = 60;
/// Factor on the first steps of the last search, which polishes the fields of open ground together.
const POLISH: f32 = 0.2;

/// A field that is searched.
#[derive(Clone, Copy)]
struct Field {
    value: fn(&mut RawCharacterProfile) -> &mut f32,
    /// First step: a share of the value, or an amount.
    step: Step,
}

#[derive(Clone, Copy)]
enum Step {
    Share(f32),
    Amount(f32),
}

const ON_GROUND: [Field; 4] = [
    Field { value: |it| &mut it.forward_speed, step: Step::Share(0.3) },
    Field { value: |it| &mut it.side_speed_share, step: Step::Amount(0.2) },
    Field { value: |it| &mut it.turn_speed, step: Step::Share(0.3) },
    Field { value: |it| &mut it.ground_acceleration, step: Step::Share(0.5) },
];
const IN_AIR: [Field; 3] = [
    Field { value: |it| &mut it.jump_speed, step: Step::Share(0.3) },
    Field { value: |it| &mut it.gravity, step: Step::Share(0.3) },
    Field { value: |it| &mut it.air_acceleration, step: Step::Share(0.5) },
];
const ON_ROUGH_GROUND: [Field; 2] = [
    Field { value: |it| &mut it.step_height, step: Step::Amount(0.2) },
    Field { value: |it| &mut it.max_slope, step: Step::Amount(0.2) },
];

/// The body whose simulated characters move most like the recorded ones, searched from `start`, whose size and special
/// moves it keeps.
pub fn fit(map: &Map, start: &CharacterProfile, recordings: &[Recording]) -> CharacterProfile {
    let jumps = |it: &&Recording| it.script.actions().iter().any(|action| action.jump > 0.0);
    // What happens at walls and kerbs must not change how fast a body runs on open ground.
    let (rough, open): (Vec<&Recording>, Vec<&Recording>) = recordings.iter().partition(|it| it.script.is_rough);
    let (air, ground): (Vec<&Recording>, Vec<&Recording>) = open.iter().copied().partition(jumps);
    let on = |recordings, kept| Search { map, recordings, kept };
    let (body, _) = on(&ground, KEPT).descend(start.clone(), &ON_GROUND, 1.0);
    let tries = (0..=MOST_EXTRA_JUMPS).filter_map(|count| body.with(|it| it.extra_jumps = count).ok());
    let found = tries.map(|body| on(&air, KEPT).descend(body, &IN_AIR, 1.0));
    let (body, _) = found.min_by(|a, b| a.1.total_cmp(&b.1)).expect("no jump in the air is in range");
    let fields = [&ON_GROUND[..], &IN_AIR].concat();
    let (body, _) = on(&open, KEPT).descend(body, &fields, POLISH);
    // Few seconds have a kerb, and these count.
    on(&rough, 1.0).descend(body, &ON_ROUGH_GROUND, 1.0).0
}

struct Search<'a> {
    map: &'a Map,
    recordings: &'a [&'a Recording],
    /// Share of the drifts of each script that count, the least first.
    kept: f64,
}

impl Search<'_> {
    /// Mean loss of a body over the decisions that count: how far it parts from the recordings within a second.
    fn loss(&self, body: &CharacterProfile) -> f64 {
        let of = |recording: &&Recording| {
            let simulated = simulate(self.map, body, recording);
            let part = |idx: usize| {
                let since = idx.saturating_sub(HORIZON);
                let moved = (simulated[idx] - simulated[since]) - (recording.track[idx] - recording.track[since]);
                huber(moved.length())
            };
            (recording.script.name, (1..recording.track.len()).map(part).collect::<Vec<f64>>())
        };
        let each: Vec<(&str, Vec<f64>)> = self.recordings.par_iter().map(of).collect();
        let mut by_script: BTreeMap<&str, Vec<f64>> = BTreeMap::new();
        each.into_iter().for_each(|(script, losses)| by_script.entry(script).or_default().extend(losses));
        let (mut sum, mut count) = (0.0, 0);
        for mut losses in by_script.into_values() {
            losses.sort_by(f64::total_cmp);
            losses.truncate((self.kept * losses.len() as f64).ceil() as usize);
            sum += losses.iter().sum::<f64>();
            count += losses.len();
        }
        sum / count.max(1) as f64
    }

    /// Changes fields as long as that lowers the loss. Returns the body with its loss.
    fn descend(&self, start: CharacterProfile, fields: &[Field], scale: f32) -> (CharacterProfile, f64) {
        let first = |field: &Field| match field.step {
            Step::Share(share) => scale * share * *(field.value)(&mut (*start).clone()),
            Step::Amount(amount) => scale * amount,
        };
        let mut steps: Vec<f32> = fields.iter().map(first).collect();
        let mut best = (self.loss(&start), start);
        let mut halvings = 0;
        for _ in 0..MAX_SWEEPS {
            let before = best.1.clone();
            if !self.sweep(fields, &steps, &mut best) {
                halvings += 1;
                if halvings > HALVINGS {
                    break;
                }
                steps.iter_mut().for_each(|step| *step *= 0.5);
                continue;
            }
            // Once more in the direction in which all fields have moved.
            let again = best.1.with(|it| {
                for field in fields {
                    let (old, new) = (*(field.value)(&mut (*before).clone()), *(field.value)(it));
                    *(field.value)(it) = 2.0 * new - old;
                }
            });
            self.take_if_better(again.ok(), &mut best);
        }
        (best.1, best.0)
    }

    /// Tries a step up and a step down for each field; returns whether one lowered the loss.
    fn sweep(&self, fields: &[Field], steps: &[f32], best: &mut (f64, CharacterProfile)) -> bool {
        let mut is_lower = false;
        for (field, step) in fields.iter().zip(steps) {
            is_lower |= [*step, -step].into_iter().any(|step| {
                let body = best.1.with(|it| *(field.value)(it) += step);
                self.take_if_better(body.ok(), best)
            });
        }
        is_lower
    }

    fn take_if_better(&self, body: Option<CharacterProfile>, best: &mut (f64, CharacterProfile)) -> bool {
        let Some(body) = body else { return false };
        let loss = self.loss(&body);
        let is_better = loss < MATERIAL * best.0;
        if is_better {
            *best = (loss, body);
        }
        is_better
    }
}

fn huber(distance: f32) -> f64 {
    let (distance, near) = (f64::from(distance), f64::from(NEAR_M));
    if distance <= near { 0.5 * distance * distance } else { near * (distance - 0.5 * near) }
}
