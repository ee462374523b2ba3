//! A world whose thread does not answer, among others that do.

use std::path::PathBuf;
use std::sync::mpsc;
use std::time::Duration;
use surefoot_net::levels::BaseMap;
use surefoot_net::serving::{Caller, Shutdown};
use surefoot_server::hosted::TimeMode;
use surefoot_server::store::StoreError;
use surefoot_server::{ServerConfig, WorldId, WorldSettings, Worlds};
use surefoot_world::{CharacterProfile, MapSpec};

/// Far longer than any step takes, so that a hang fails the test instead of blocking it.
const LIMIT: Duration = Duration::from_secs(60);

async fn create(worlds: &Worlds, caller: &Caller) -> WorldId {
    let settings = WorldSettings {
        mode: TimeMode::Realtime,
        body: CharacterProfile::default(),
        solid_npcs: false,
        zones: Vec::new(),
    };
    let made = BaseMap::Spec(MapSpec::with_side(1, 50).expect("a small map"));
    worlds.create(caller, made.into(), settings).await.expect("a world").id
}

/// A folder of this process, removed on drop.
struct Folder(PathBuf);

impl Folder {
    fn file_of(&self, id: WorldId) -> PathBuf {
        self.0.join(format!("{id}.world"))
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        // Only a test's.
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_world_whose_thread_is_stuck_is_dropped_and_keeps_no_other_from_being_saved() {
    let folder = Folder(std::env::temp_dir().join(format!("surefoot-stuck-{}", std::process::id())));
    let config = ServerConfig { state: Some(folder.0.clone()), ..ServerConfig::default() };
    let worlds = Worlds::new(config, Shutdown::default());
    worlds.open_state().expect("an empty folder");
    let caller = Caller::on_behalf_of("game");
    let (stuck, other) = (create(&worlds, &caller).await, create(&worlds, &caller).await);
    worlds.save_all(false, LIMIT).await.expect("both answer");
    assert!(folder.file_of(stuck).exists());
    std::fs::remove_file(folder.file_of(other)).expect("it was saved");
    let (free, is_free) = mpsc::channel::<()>();
    // Until the sender is dropped.
    worlds.handle(stuck).expect("it runs").sim.cast(move |_| _ = is_free.recv()).expect("its inbox is empty");
    let saving = tokio::spawn({
        let worlds = worlds.clone();
        async move { worlds.save_all(false, LIMIT).await }
    });
    // Both saves have begun.
    while !folder.file_of(other).exists() {
        tokio::task::yield_now().await;
    }
    let dropped = tokio::time::timeout(LIMIT, worlds.drop_world(&caller, stuck)).await;
    dropped.expect("a stuck thread holds up no one").expect("its owner may");
    assert!(!folder.file_of(stuck).exists());
    saving.await.expect("no panic").expect("nothing is missing: the one was saved, the other dropped");
    drop(free);
    worlds.save_all(false, LIMIT).await.expect("the other one answers");
    assert!(!folder.file_of(stuck).exists(), "it does not come back");
    // One that is stuck and not dropped is reported.
    let (free, is_free) = mpsc::channel::<()>();
    worlds.handle(other).expect("it runs").sim.cast(move |_| _ = is_free.recv()).expect("its inbox is empty");
    let silent = worlds.save_all(false, LIMIT).await.expect_err("it does not answer");
    assert!(matches!(silent, StoreError::Silent(id) if id == other), "{silent}");
    drop(free);
    worlds.stop();
}
