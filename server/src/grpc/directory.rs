//! `DirectoryService`: the servers of a fleet, and the server of each world.

use crate::ids::WorldId;
use crate::store::ServerInfo;
use crate::worlds::{Worlds, WorldsError};
use surefoot_net::status::Answer;
use surefoot_proto::world::v1 as wire;
use surefoot_proto::world::v1::directory_service_server::DirectoryService;
use tonic::{Request, Response};

#[derive(Debug, Clone)]
pub struct DirectoryApi {
    pub worlds: Worlds,
}

#[tonic::async_trait]
impl DirectoryService for DirectoryApi {
    async fn locate_world(&self, request: Request<wire::LocateWorldRequest>) -> Answer<wire::LocateWorldResponse> {
        let id = WorldId(request.into_inner().world_id);
        match self.worlds.locate(id).await? {
            None => Err(WorldsError::UnknownWorld(id).into()),
            Some(server) if !server.is_alive => Err(WorldsError::Moving(id).into()),
            Some(server) => Ok(Response::new(wire::LocateWorldResponse { server: Some(server_to_wire(server)) })),
        }
    }

    async fn list_servers(&self, _: Request<wire::ListServersRequest>) -> Answer<wire::ListServersResponse> {
        let servers = self.worlds.servers().await?;
        Ok(Response::new(wire::ListServersResponse { servers: servers.into_iter().map(server_to_wire).collect() }))
    }
}

fn server_to_wire(server: ServerInfo) -> wire::ServerInfo {
    let ServerInfo { address, is_here, world_count, .. } = server;
    wire::ServerInfo { address, is_this: is_here, world_count }
}
