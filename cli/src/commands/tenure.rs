//! `surefoot serve --store`: a world server of a fleet.

use super::services::parse_seconds;
use anyhow::{Context, ensure};
use std::net::SocketAddr;
use std::time::Duration;
use surefoot_server::ServerConfig;

/// The fleet that a server belongs to.
#[derive(clap::Args)]
#[command(next_help_heading = "Fleet")]
pub struct TenureArgs {
    /// Be a server of a fleet, whose record is the PostgreSQL database postgres://user:password@host:port/database
    #[arg(long, value_name = "URL")]
    store: Option<String>,
    /// Where the servers of the fleet save worlds: s3://bucket/prefix, or file:///folder for servers on one machine
    #[arg(long, value_name = "URI")]
    blobs: Option<String>,
    /// URI at which clients and workers reach this server of the fleet; default: the address of --listen
    #[arg(long, value_name = "URI")]
    address: Option<String>,
    /// How long this server keeps its worlds when it is silent; after that, others take them over
    #[arg(long, default_value_t = 5.0, value_name = "SECONDS", value_parser = parse_seconds)]
    lease: f64,
}

/// Time between two saves of a server in a fleet.
const SAVE_EVERY: Duration = Duration::from_secs(2);

impl TenureArgs {
    /// Time between two saves, unless the user says otherwise; `alone` for a server without a fleet.
    pub fn save_every(&self, alone: Duration) -> Duration {
        if self.store.is_some() { SAVE_EVERY } else { alone }
    }

    /// Joins the fleet, if there is one, as a server that listens at `address`.
    pub async fn join(&self, config: ServerConfig, address: SocketAddr) -> anyhow::Result<ServerConfig> {
        let Some(store) = &self.store else { return Ok(config) };
        ensure!(config.state.is_none(), "--state is for a server alone, --store for one of a fleet");
        let blobs = self.blobs.as_deref().context("--store needs --blobs")?;
        let named = self.address.clone();
        ensure!(
            named.is_some() || !address.ip().is_unspecified(),
            "a server of a fleet that listens at {address} needs --address"
        );
        self.open(config, store, blobs, &named.unwrap_or_else(|| format!("http://{address}"))).await
    }

    #[cfg(feature = "fleet")]
    async fn open(
        &self,
        config: ServerConfig,
        store: &str,
        blobs: &str,
        address: &str,
    ) -> anyhow::Result<ServerConfig> {
        use surefoot_fleet::{blobs::Blobs, record::Record, worlds::FleetWorlds};
        let (record, blobs) = (Record::open(store).await?, Blobs::open(blobs)?);
        let lease = Duration::from_secs_f64(self.lease);
        let worlds = FleetWorlds::join(record, blobs, address, lease).await?;
        Ok(ServerConfig { store: Some(std::sync::Arc::new(worlds)), ..config })
    }

    #[cfg(not(feature = "fleet"))]
    #[expect(clippy::unused_async, reason = "with the feature, it connects")]
    async fn open(&self, _: ServerConfig, _: &str, _: &str, _: &str) -> anyhow::Result<ServerConfig> {
        let _ = self.lease;
        anyhow::bail!("--store needs a program that was built with --features fleet")
    }
}
