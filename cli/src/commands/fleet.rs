//! `--store`, `--blobs`, `--address` and `--lease`: what processes of a fleet share.

use super::services::parse_seconds;
use anyhow::{Context, bail, ensure};
use std::fmt;
use std::net::SocketAddr;
use surefoot_planner_service::Common;

/// What processes of a fleet share.
#[derive(clap::Args)]
#[command(next_help_heading = "Fleet")]
pub struct FleetArgs {
    /// Database that this process shares with others, postgres://user:password@host:port/database; default: it has its own store
    #[arg(long, value_name = "URL", env = "SUREFOOT_STORE", hide_env_values = true)]
    store: Option<String>,
    /// Place of graphs and levels in a fleet: s3://bucket/prefix or file:///folder
    #[arg(long, value_name = "URL", env = "SUREFOOT_BLOBS")]
    blobs: Option<String>,
    /// URI at which others of the fleet reach this process; default: http:// and the address of --listen
    #[arg(long, value_name = "URI", env = "SUREFOOT_ADDRESS")]
    address: Option<String>,
    /// Silence after which the fleet takes this process for dead
    #[arg(long, default_value_t = 5.0, value_name = "SECONDS", env = "SUREFOOT_LEASE", value_parser = parse_seconds)]
    lease: f64,
}

/// Where a fleet has its record and blobs, and this process in it.
#[cfg_attr(not(feature = "fleet"), expect(dead_code, reason = "such a program is in no fleet"))]
pub struct FleetPlace {
    store: String,
    blobs: String,
    address: String,
    lease: std::time::Duration,
}

impl FleetArgs {
    /// The fleet of a process that listens at `listen`; `None` if it has its own store.
    pub fn place(&self, listen: SocketAddr) -> anyhow::Result<Option<FleetPlace>> {
        let Some(store) = self.store.clone() else {
            ensure!(
                self.blobs.is_none() && self.address.is_none(),
                "--blobs and --address belong to a fleet: add --store"
            );
            return Ok(None);
        };
        if !cfg!(feature = "fleet") {
            bail!("--store needs a program that was built with --features fleet");
        }
        let blobs = self.blobs.clone().context("--store needs --blobs: s3://bucket/prefix or file:///folder")?;
        let address = match &self.address {
            Some(address) => address.clone(),
            None if listen.ip().is_unspecified() => {
                bail!("--store needs --address, since nobody reaches this process at {listen}")
            }
            None => format!("http://{listen}"),
        };
        Ok(Some(FleetPlace { store, blobs, address, lease: std::time::Duration::from_secs_f64(self.lease) }))
    }
}

impl FleetPlace {
    /// Joins the planners.
    #[cfg(feature = "fleet")]
    pub async fn planner_stores(&self) -> anyhow::Result<Common> {
        use surefoot_fleet::{blobs::Blobs, planners::PlannerRecord, record::Record};
        let blobs = Blobs::open(&self.blobs)?;
        let record = Record::open(&self.store).await?;
        let joined = PlannerRecord::join(record, blobs, self.address.clone(), self.lease).await?;
        Ok(joined.into_stores())
    }

    /// Joins the planners.
    #[cfg(not(feature = "fleet"))]
    pub async fn planner_stores(&self) -> anyhow::Result<Common> {
        bail!("this program was built without a fleet");
    }
}

impl fmt::Display for FleetPlace {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "the fleet with blobs at {}", self.blobs)
    }
}
