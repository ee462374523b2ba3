//! `surefoot act`.

use crate::train::{connector, copy_levels, stop_on_signal};
use anyhow::Context;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use surefoot_cli::commands::endpoint::CredentialArgs;
use surefoot_cli::commands::map::{LevelArgs, files_only, parse_maps};
use surefoot_train::actors::actor::{ActorConfig, act};

/// Collect experience for a learner in another process (`surefoot train --listen`), with its current weights. Needs
/// less bandwidth than `train --worlds`. Waits while the learner is unreachable.
#[derive(clap::Args)]
#[command(after_help = "Examples:\n  \
        surefoot act --learner http://127.0.0.1:7610\n  \
        surefoot act --learner https://learner.example:7610 --token-file token --maps level.glb \
        --world http://127.0.0.1:7700")]
pub struct Args {
    /// Address of the learner
    #[arg(long, value_name = "URI", env = "SUREFOOT_LEARNER")]
    learner: String,
    /// Run the NPCs in the game at this address instead of this process; the game runs the level of --maps
    #[arg(long, value_name = "URI")]
    world: Option<String>,
    /// Levels to act on instead of the learner's maps: files (.sfmap, .glb, .gltf, .obj), or patterns such as
    /// levels/*.glb
    #[arg(long, value_name = "FILE,...", num_args = 1..)]
    maps: Vec<String>,
    #[command(flatten)]
    levels: LevelArgs,
    /// Name of this actor; must be unique
    #[arg(long, value_name = "NAME")]
    name: Option<String>,
    /// Seed of goals and noise; default: drawn from the name
    #[arg(long, value_name = "SEED")]
    seed: Option<u64>,
    #[command(flatten)]
    credentials: CredentialArgs,
}

pub fn run(args: Args) -> anyhow::Result<()> {
    let credentials = args.credentials.credentials()?;
    let since = std::time::UNIX_EPOCH.elapsed().unwrap_or_default().as_nanos();
    let actor_id = args.name.unwrap_or_else(|| format!("{}-{since:x}", std::process::id()));
    // FNV-1a: different names give different seeds.
    let hash = |hash: u64, byte: u8| (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01B3);
    let seed = args.seed.unwrap_or_else(|| actor_id.bytes().fold(0xCBF2_9CE4_8422_2325, hash));
    let folder = std::env::temp_dir().join(format!("surefoot-act-{}", std::process::id()));
    let maps = parse_maps(&args.maps).context("--maps")?;
    args.levels.check(&maps)?;
    let files = files_only(maps).context("--maps: the learner chooses the seeds")?;
    let levels = if files.is_empty() { files } else { copy_levels(&files, &args.levels, &folder)? };
    let connect = connector(credentials.clone());
    let stop = Arc::new(AtomicBool::new(false));
    stop_on_signal(stop.clone())?;
    let config = ActorConfig { learner: args.learner, credentials, actor_id, seed, levels, world: args.world, connect };
    let acted = act(config, &stop, |line| println!("{line}"));
    if folder.exists() {
        std::fs::remove_dir_all(&folder).with_context(|| format!("cannot remove {}", folder.display()))?;
    }
    Ok(acted?)
}
