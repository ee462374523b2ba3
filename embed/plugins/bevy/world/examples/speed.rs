//! How many decisions a second the game carries out, rays included: 128 characters that wander about a level.
//!
//!   cargo run --release -p surefoot-bevy-world --example speed -- level.glb

use anyhow::{Context, bail};
use bevy_surefoot::SurefootLevel;
use std::time::Instant;
use surefoot_bevy_world::{app, scene};
use surefoot_game::{Action, CharacterProfile, Command, Level};
use surefoot_world::sense::{RAY_RANGE_M, RayCone};
use surefoot_world::{Body, TICKS_PER_DECISION};

const CHARACTERS: usize = 128;
const DECISIONS: usize = 200;

fn main() -> anyhow::Result<()> {
    let Some(path) = std::env::args().nth(1) else { bail!("usage: speed LEVEL") };
    let level = SurefootLevel::load(&path).with_context(|| format!("cannot use {path}"))?;
    let (scene, calls) = scene(&level);
    let mut app = app(&level, calls);
    let driver = std::thread::spawn(move || -> Result<f64, String> {
        let profile = CharacterProfile::default();
        let places = scene.places(&profile, 1)?;
        let mut world = scene.open(&profile, CHARACTERS)?;
        drop(scene);
        (0..CHARACTERS).for_each(|idx| world.place(idx, places[idx], idx as f32));
        let cone = RayCone::default();
        let began = Instant::now();
        for decision in 0..DECISIONS {
            // Each runs in curves of its own, and jumps now and then.
            let action = |idx: usize| Action {
                forward: 1.0,
                turn: ((idx * 7 + decision) % 11) as f32 / 5.0 - 1.0,
                jump: if (idx + decision).is_multiple_of(5) { 1.0 } else { -1.0 },
                ..Action::default()
            };
            for tick in 0..TICKS_PER_DECISION {
                let command = |idx| (idx, Command { action: action(idx), is_first: tick == 0 });
                world.tick(&(0..CHARACTERS).map(command).collect::<Vec<_>>());
            }
            for idx in 0..CHARACTERS {
                let body = Body::at(world.state(idx).feet, world.state(idx).yaw);
                world.cast(RayCone::eye(&profile, &body), &cone.directions_of(&body), RAY_RANGE_M);
            }
        }
        Ok((CHARACTERS * DECISIONS) as f64 / began.elapsed().as_secs_f64())
    });
    app.run();
    let speed = driver.join().expect("the driver does not panic").map_err(anyhow::Error::msg)?;
    println!("{speed:.0} decisions/s with {CHARACTERS} characters");
    Ok(())
}
