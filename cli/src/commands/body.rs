//! `surefoot body`: bodies like the characters of games.

use super::game::WorldArgs;
use super::map::{BodyArg, Source};
use crate::terminal::{print_json, with_spinner};
use anyhow::Context;
use serde::Serialize;
use std::fmt::Write;
use std::path::PathBuf;
use std::sync::Arc;
use surefoot_game_client::Level;
use surefoot_game_client::fit::{Drift, drifts, fit, record};
use surefoot_world::CharacterProfile;

/// A subcommand of `surefoot body`.
#[derive(clap::Subcommand)]
pub enum Command {
    /// Fit a body to the characters of a game.
    ///
    /// Characters run, turn, jump, and cross steps and slopes of the level in the game, for about two seconds each.
    /// The body whose simulated characters move most like them is written, with how far they still part.
    Fit(Box<FitArgs>),
}

/// Arguments of `surefoot body fit`.
#[derive(clap::Args)]
#[command(after_help = "Examples:\n  \
        surefoot body fit level.glb --world tcp://127.0.0.1:7701 --out mine.toml\n  \
        surefoot body fit level.glb --world http://127.0.0.1:7700 --body unity --out mine.toml --json")]
pub struct FitArgs {
    #[command(flatten)]
    source: Source,
    #[command(flatten)]
    world: WorldArgs,
    /// The body to start from. Its size and special moves are kept
    #[command(flatten)]
    body: BodyArg,
    /// Seed of the places from which characters start
    #[arg(long, default_value_t = 0, value_name = "SEED")]
    seed: u64,
    /// File to write the body to, for --body
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Print one JSON document
    #[arg(long)]
    json: bool,
}

/// A script whose drift is larger than this at the 90th percentile is not explained by the body, m.
const EXPLAINED_M: f32 = 0.15;

/// Reads a field of a body.
type Value = fn(&CharacterProfile) -> f32;

/// What was fitted, for output.
#[derive(Serialize)]
struct Report {
    body: CharacterProfile,
    characters: usize,
    drifts: Vec<DriftReport>,
}

#[derive(Serialize)]
struct DriftReport {
    script: &'static str,
    before_p90_m: f32,
    p50_m: f32,
    p90_m: f32,
    seconds: usize,
}

/// Runs a subcommand.
pub fn run(command: &Command) -> anyhow::Result<()> {
    let Command::Fit(args) = command;
    args.run()
}

impl FitArgs {
    fn run(&self) -> anyhow::Result<()> {
        let game = self.world.connect()?.context("name the game whose characters move: --world URI")?;
        let (map, start) = (Arc::new(self.source.load()?), self.body.profile()?);
        let level = Level { map: map.clone(), body: start.clone(), solid_npcs: false };
        let recordings = with_spinner("recording", || record(&game, &level, self.seed))?;
        let body = with_spinner("fitting", || fit(&map, &start, &recordings));
        let [before, after] = [&start, &body].map(|body| drifts(&map, body, &recordings));
        let text = toml::to_string(&body).context("cannot write the body as TOML")?;
        std::fs::write(&self.out, text).with_context(|| format!("cannot write {}", self.out.display()))?;
        let drifts = before.into_iter().zip(after).map(|(before, Drift { script, p50_m, p90_m, count })| DriftReport {
            script,
            before_p90_m: before.p90_m,
            p50_m,
            p90_m,
            seconds: count,
        });
        let report = Report { body, characters: recordings.len(), drifts: drifts.collect() };
        if self.json {
            return print_json(&report);
        }
        print!("{}", self.text(&start, &report));
        Ok(())
    }

    fn text(&self, start: &CharacterProfile, report: &Report) -> String {
        let mut text =
            format!("{} characters moved in the game\n\nfield                   before    fitted\n", report.characters);
        let fields: [(&str, Value); 10] = [
            ("forward_speed", |it| it.forward_speed),
            ("side_speed_share", |it| it.side_speed_share),
            ("turn_speed", |it| it.turn_speed),
            ("ground_acceleration", |it| it.ground_acceleration),
            ("jump_speed", |it| it.jump_speed),
            ("gravity", |it| it.gravity),
            ("air_acceleration", |it| it.air_acceleration),
            ("extra_jumps", |it| f32::from(it.extra_jumps)),
            ("step_height", |it| it.step_height),
            ("max_slope", |it| it.max_slope),
        ];
        for (name, value) in fields {
            writeln!(text, "{name:<20} {:>9.3} {:>9.3}", value(start), value(&report.body))
                .expect("a string takes all");
        }
        text.push_str("\nparted within a second, m      median  90 % within  before\n");
        for DriftReport { script, p50_m, p90_m, before_p90_m, .. } in &report.drifts {
            writeln!(text, "{script:<30} {p50_m:>6.3} {p90_m:>12.3} {before_p90_m:>7.3}").expect("a string takes all");
        }
        let open = report.drifts.iter().filter(|it| it.p90_m > EXPLAINED_M && it.script != "all");
        let open: Vec<&str> = open.map(|it| it.script).collect();
        match open.is_empty() {
            true => writeln!(text, "\nThe body explains all moves."),
            false => writeln!(text, "\nNot explained (beyond {EXPLAINED_M} m): {}", open.join(", ")),
        }
        .expect("a string takes all");
        writeln!(text, "Written to {0}: use it with --body {0}", self.out.display()).expect("a string takes all");
        text
    }
}
