//! `--store`, `--blobs`, `--address` and `--lease`: the flags of servers and planners in a fleet.

use super::BlobsArg;
use crate::commands::parse_seconds;
use anyhow::{Context, bail, ensure};
use std::fmt;
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;
use surefoot_planner_service::PlannerStores;
use surefoot_server::store::WorldStore;

/// Flags of servers and planners in a fleet.
#[derive(clap::Args)]
#[command(next_help_heading = "Fleet")]
pub struct StoreArgs {
    /// PostgreSQL database that the processes of a fleet share, postgres://user:password@host:port/database; default:
    /// this process is alone
    #[arg(long, value_name = "URL", env = "SUREFOOT_STORE", hide_env_values = true)]
    store: Option<String>,
    #[command(flatten)]
    blobs: BlobsArg,
    /// URI at which clients and the rest of the fleet reach this process; default: http:// and the address of --listen
    #[arg(long, value_name = "URI", env = "SUREFOOT_ADDRESS")]
    address: Option<String>,
    /// Time without a renewal after which the fleet treats this process as dead
    #[arg(long, default_value_t = 5.0, value_name = "SECONDS", env = "SUREFOOT_LEASE", value_parser = parse_seconds)]
    lease: f64,
}

/// The stores of a fleet, and this process in it.
#[cfg_attr(not(feature = "fleet"), expect(dead_code, reason = "without the feature there is no fleet"))]
pub struct Place {
    store: String,
    blobs: String,
    address: String,
    lease: Duration,
}

impl StoreArgs {
    /// The object store.
    #[cfg(feature = "fleet")]
    pub fn blobs(&self) -> Option<&str> {
        self.blobs.blobs.as_deref()
    }

    /// The fleet of a process that listens at `listen`; `None` without `--store`.
    pub fn place(&self, listen: SocketAddr) -> anyhow::Result<Option<Place>> {
        let Some(store) = self.store.clone() else {
            ensure!(self.address.is_none(), "--address needs --store");
            return Ok(None);
        };
        ensure!(cfg!(feature = "fleet"), "--store needs a program that was built with --features fleet");
        let blobs = self.blobs.blobs.clone().context("--store needs --blobs: s3://bucket/prefix or file:///folder")?;
        let address = match &self.address {
            Some(address) => address.clone(),
            None if listen.ip().is_unspecified() => {
                bail!("--store needs --address: other processes cannot reach {listen}")
            }
            None => format!("http://{listen}"),
        };
        Ok(Some(Place { store, blobs, address, lease: Duration::from_secs_f64(self.lease) }))
    }
}

#[cfg(feature = "fleet")]
impl Place {
    /// Joins the planners.
    pub async fn planner_stores(&self) -> anyhow::Result<PlannerStores> {
        let (record, blobs) = self.open().await?;
        let joined = surefoot_fleet::planners::FleetPlanner::join(record, blobs, self.address.clone(), self.lease);
        Ok(joined.await?.into_stores())
    }

    /// Joins the servers.
    pub async fn world_store(&self) -> anyhow::Result<Arc<dyn WorldStore>> {
        let (record, blobs) = self.open().await?;
        Ok(Arc::new(surefoot_fleet::worlds::FleetWorlds::join(record, blobs, &self.address, self.lease).await?))
    }

    async fn open(&self) -> anyhow::Result<(surefoot_fleet::database::Database, surefoot_fleet::blobs::Blobs)> {
        let blobs = surefoot_fleet::blobs::Blobs::open(&self.blobs)?;
        Ok((surefoot_fleet::database::Database::open(&self.store).await?, blobs))
    }
}

#[cfg(not(feature = "fleet"))]
#[expect(clippy::unused_async, reason = "with the feature, they connect")]
impl Place {
    /// Joins the planners.
    pub async fn planner_stores(&self) -> anyhow::Result<PlannerStores> {
        bail!("this program was built without the feature fleet");
    }

    /// Joins the servers.
    pub async fn world_store(&self) -> anyhow::Result<Arc<dyn WorldStore>> {
        bail!("this program was built without the feature fleet");
    }
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "the fleet with blobs at {}", self.blobs)
    }
}
