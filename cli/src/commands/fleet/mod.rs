//! Flags of what the processes of a fleet share, and what is built of them. Builds without the feature `fleet` have the
//! flags, and say so where one is used.

pub mod migrate;
pub mod prove;
#[cfg(feature = "fleet")]
mod shared;
mod store;
#[cfg(feature = "fleet")]
pub mod units;

#[cfg(feature = "fleet")]
pub use shared::Shared;
pub use store::StoreArgs;

/// The queue of a fleet.
#[derive(clap::Args, Clone)]
#[command(next_help_heading = "Fleet")]
pub struct NatsArg {
    /// URL of NATS JetStream, over which provers (surefoot prove) share the work: nats://user:password@host:port;
    /// several are divided by commas
    #[arg(long, value_name = "URL", env = "SUREFOOT_NATS", hide_env_values = true)]
    pub nats: Option<String>,
}

/// The object store of a fleet.
#[derive(clap::Args, Clone)]
#[command(next_help_heading = "Fleet")]
pub struct BlobsArg {
    /// Object store of a fleet, for graphs, worlds, levels and the maps of jobs: s3://bucket/prefix or file:///folder
    #[arg(long, value_name = "URI", env = "SUREFOOT_BLOBS")]
    pub blobs: Option<String>,
}

impl NatsArg {
    /// Checks that this build supports the flag.
    pub fn check(&self) -> anyhow::Result<()> {
        let can = cfg!(feature = "fleet");
        anyhow::ensure!(can || self.nats.is_none(), "--nats needs a program that was built with --features fleet");
        Ok(())
    }
}
