//! `DirectoryService`: where worlds run.

use super::errors::TAKEOVER_TIME;
use crate::ids::WorldId;
use crate::store::ServerInfo;
use crate::worlds::{Worlds, WorldsError};
use surefoot_net::status;
use surefoot_proto::reason::Reason;
use surefoot_proto::world::v1 as wire;
use surefoot_proto::world::v1::directory_service_server::DirectoryService;
use tonic::{Request, Response, Status};

/// Implementation of `DirectoryService`.
#[derive(Debug, Clone)]
pub struct DirectoryApi {
    /// The worlds of this server.
    pub worlds: Worlds,
}

#[tonic::async_trait]
impl DirectoryService for DirectoryApi {
    async fn locate_world(
        &self,
        request: Request<wire::LocateWorldRequest>,
    ) -> Result<Response<wire::LocateWorldResponse>, Status> {
        let id = WorldId(request.into_inner().world_id);
        match self.worlds.locate(id).await? {
            None => Err(WorldsError::UnknownWorld(id).into()),
            Some(place) if !place.is_alive => Err(moving(id)),
            Some(place) => Ok(Response::new(wire::LocateWorldResponse { server: Some(place_to_wire(place)) })),
        }
    }

    async fn list_servers(
        &self,
        _: Request<wire::ListServersRequest>,
    ) -> Result<Response<wire::ListServersResponse>, Status> {
        let servers = self.worlds.servers().await?;
        Ok(Response::new(wire::ListServersResponse { servers: servers.into_iter().map(place_to_wire).collect() }))
    }
}

/// The status for a world whose server is gone.
pub(super) fn moving(id: WorldId) -> Status {
    let message = format!("the server of world {id} is gone, and another one takes it over: try again");
    status::retry(Reason::WorldMoving, TAKEOVER_TIME, message)
}

fn place_to_wire(place: ServerInfo) -> wire::ServerInfo {
    let ServerInfo { address, is_here, world_count, .. } = place;
    wire::ServerInfo { address, is_this: is_here, world_count }
}
