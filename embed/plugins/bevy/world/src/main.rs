//! Serves a level of a game on Bevy and avian as a world.
//!
//!   cargo run --release -p surefoot-bevy-world -- level.glb 127.0.0.1:7700
//!   surefoot graph export level.glb --world http://127.0.0.1:7700 --format json --out level.json
//!   surefoot eval --maps level.glb --world http://127.0.0.1:7700 --graph level.json
//!
//! The level is a file in a format that Surefoot reads (.glb, .gltf, .obj, .sfmap). Its geometry becomes colliders;
//! water and lava become areas. Pads, zip lines, teleporters and jetpacks have no effect here: use levels without them.

use anyhow::{Context, anyhow, bail};
use bevy_surefoot::SurefootLevel;
use surefoot_bevy_world::{ENVS, app, scene};

fn main() -> anyhow::Result<()> {
    let mut args = std::env::args().skip(1);
    let (Some(path), Some(address)) = (args.next(), args.next()) else {
        bail!("usage: surefoot-bevy-world LEVEL ADDRESS, such as: surefoot-bevy-world level.glb 127.0.0.1:7700");
    };
    let level = SurefootLevel::load(&path).with_context(|| format!("cannot use {path}"))?;
    let address = address.parse().with_context(|| format!("{address} is no address such as 127.0.0.1:7700"))?;
    let (scene, calls) = scene(&level);
    let server = std::thread::spawn(move || surefoot_game::serve_blocking(scene, address, ENVS));
    println!("avian runs {path} at http://{address}");
    // The app ends when the server has failed: no call can reach it then.
    app(&level, calls).run();
    server.join().map_err(|_| anyhow!("the server stopped"))?.map_err(Into::into)
}
