//! What a server of a fleet says of worlds that are not here, and what it keeps to itself when the record of the fleet
//! fails.

use e2e::{create_world, ground, spawn, start_server, world_client};
use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;
use surefoot_proto::reason::Reason;
use surefoot_proto::world::v1 as wire;
use surefoot_proto::world::v1::directory_service_client::DirectoryServiceClient;
use surefoot_server::hosted::{Journal, SavedLog, WorldSave};
use surefoot_server::store::{LeaseEpoch, LoadedWorld, ServerInfo, SharedStore, StoreError, WorldStore, async_trait};
use surefoot_server::{NpcId, ServerConfig, WorldId};
use tonic::Status;

/// Text that no client may see.
const SECRET: &str = "error returned from database: 57P01 at postgres://surefoot@db.internal:5432/fleet";
const ELSEWHERE: WorldId = WorldId(1);
const MOVING: WorldId = WorldId(2);
const NOWHERE: WorldId = WorldId(3);
const UNANSWERED: WorldId = WorldId(4);

/// A fleet of which all is well but the record of one world, and deletions.
#[derive(Debug)]
struct Fleet;

fn broken<T>() -> Result<T, StoreError> {
    Err(StoreError::Unavailable(SECRET.to_owned()))
}

#[async_trait]
impl WorldStore for Fleet {
    async fn list(&self) -> Result<Vec<WorldId>, StoreError> {
        Ok(Vec::new())
    }

    async fn read(&self, _: WorldId) -> Result<LoadedWorld, StoreError> {
        broken()
    }

    async fn write(&self, _: LeaseEpoch, _: WorldSave, _: SavedLog) -> Result<(), StoreError> {
        Ok(())
    }

    async fn forget(&self, _: WorldId) -> Result<(), StoreError> {
        broken()
    }

    fn shared(&self) -> Option<&dyn SharedStore> {
        Some(self)
    }
}

#[async_trait]
impl SharedStore for Fleet {
    fn lease(&self) -> Duration {
        Duration::from_secs(5)
    }

    fn lease_epoch(&self) -> LeaseEpoch {
        LeaseEpoch(1)
    }

    fn holds_lease(&self) -> bool {
        true
    }

    async fn renew(&self) -> Result<(), StoreError> {
        Ok(())
    }

    async fn rejoin(&self) -> Result<(), StoreError> {
        Ok(())
    }

    async fn leave(&self) -> Result<(), StoreError> {
        Ok(())
    }

    async fn changed(&self) {
        std::future::pending().await
    }

    async fn new_id(&self, earliest: WorldId) -> Result<WorldId, StoreError> {
        Ok(earliest)
    }

    async fn claim(&self, _: usize, _: &[WorldId]) -> Result<Vec<WorldId>, StoreError> {
        Ok(Vec::new())
    }

    async fn hand_back(&self, _: WorldId) -> Result<(), StoreError> {
        Ok(())
    }

    async fn append_journals(
        &self,
        _: LeaseEpoch,
        journals: &[(WorldId, Journal)],
    ) -> Result<BTreeMap<WorldId, bool>, StoreError> {
        Ok(journals.iter().map(|(id, _)| (*id, true)).collect())
    }

    async fn locate(&self, id: WorldId) -> Result<Option<ServerInfo>, StoreError> {
        let place = |is_alive| {
            Some(ServerInfo { address: "http://other:7600".to_owned(), is_here: false, is_alive, world_count: 1 })
        };
        match id {
            ELSEWHERE => Ok(place(true)),
            MOVING => Ok(place(false)),
            UNANSWERED => broken(),
            _ => Ok(None),
        }
    }

    async fn servers(&self) -> Result<Vec<ServerInfo>, StoreError> {
        broken()
    }
}

fn check_is_clean(message: &str) {
    for part in ["db.internal", "5432", "postgres", "57P01", "database"] {
        assert!(!message.contains(part), "`{message}` reaches clients");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn items_of_a_batch_say_where_their_worlds_are_and_no_text_of_the_database_reaches_clients() {
    let server = start_server(ServerConfig { store: Some(Arc::new(Fleet)), ..ServerConfig::default() });
    let mut client = world_client(&server).await;
    let world_id = create_world(&mut client, 1000, wire::TimeMode::Realtime).await.world_id;
    let place = ground(&mut client, world_id, 1).await[0];
    let here = spawn(&mut client, world_id, place).await;
    let cases = [
        (here, "", ""),
        (NpcId::new(ELSEWHERE, 1).0, "WORLD_ELSEWHERE", "http://other:7600"),
        (NpcId::new(MOVING, 1).0, "WORLD_MOVING", ""),
        (NpcId::new(NOWHERE, 1).0, "NPC_NOT_FOUND", ""),
        (NpcId::new(UNANSWERED, 1).0, "NOT_CONFIRMED", ""),
        (NpcId::new(ELSEWHERE, 2).0, "WORLD_ELSEWHERE", "http://other:7600"),
    ];
    let npc_ids: Vec<u64> = cases.iter().map(|case| case.0).collect();
    let request = wire::BatchGetNpcsRequest { npc_ids: npc_ids.clone(), ..Default::default() };
    let found = client.batch_get_npcs(request).await.unwrap().into_inner().results;
    let teleports: Vec<wire::TeleportNpcRequest> = npc_ids
        .iter()
        .map(|&npc_id| wire::TeleportNpcRequest { npc_id, position: Some(place), yaw: 0.0, ..Default::default() })
        .collect();
    let request = wire::BatchTeleportNpcsRequest { teleports };
    let moved = client.batch_teleport_npcs(request).await.unwrap().into_inner().results;
    for (idx, (npc_id, reason, words)) in cases.into_iter().enumerate() {
        let error = match found[idx].result.clone().unwrap() {
            wire::get_npc_result::Result::Npc(_) => wire::ItemError::default(),
            wire::get_npc_result::Result::Error(error) => error,
        };
        for error in [&error, moved[idx].error.as_ref().unwrap_or(&wire::ItemError::default())] {
            assert!(error.reason == reason && error.message.contains(words), "{npc_id}: {error:?}");
            check_is_clean(&error.message);
        }
        let single = client.get_npc(wire::GetNpcRequest { npc_id, ..Default::default() }).await.err();
        let single_reason = single.as_ref().and_then(Reason::of).map_or("", Reason::name);
        assert_eq!(single_reason, reason, "a single call says the same");
    }
    let mut directory = DirectoryServiceClient::connect(server.uri.clone()).await.unwrap();
    let locate = wire::LocateWorldRequest { world_id: UNANSWERED.0 };
    let failures: [Status; 3] = [
        client.drop_world(wire::DropWorldRequest { world_id }).await.unwrap_err(),
        directory.list_servers(wire::ListServersRequest {}).await.unwrap_err(),
        directory.locate_world(locate).await.unwrap_err(),
    ];
    for failure in failures {
        assert_eq!(Reason::of(&failure), Some(Reason::NotConfirmed), "{failure}");
        check_is_clean(failure.message());
    }
    // A batch does not flood the record of the fleet: it looks for a few worlds, and says of the others that they may
    // be moving.
    let npc_ids = (10..100).map(|number| NpcId::new(WorldId(number), 1).0).collect();
    let many = client
        .batch_get_npcs(wire::BatchGetNpcsRequest { npc_ids, ..Default::default() })
        .await
        .unwrap()
        .into_inner()
        .results;
    let with = |wanted: &str| {
        let is_wanted = |result: &&wire::GetNpcResult| match result.result.as_ref().unwrap() {
            wire::get_npc_result::Result::Error(error) => error.reason == wanted,
            wire::get_npc_result::Result::Npc(_) => false,
        };
        many.iter().filter(is_wanted).count()
    };
    assert_eq!((with("NPC_NOT_FOUND"), with("WORLD_MOVING")), (16, 74));
    server.stop().await;
}
