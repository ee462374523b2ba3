//! `surefoot serve --agones`.

use surefoot_server::ServerError;
use surefoot_server::observer::Observer;

/// What Agones is told.
#[derive(clap::Args)]
#[command(next_help_heading = "Agones")]
pub struct AgonesArgs {
    /// Be a game server of Agones: report state, health, and counters of worlds and NPCs to its sidecar on this machine
    #[arg(long)]
    agones: bool,
    /// Port at which the sidecar serves gRPC
    #[arg(long, default_value_t = 9357, value_name = "PORT", env = "AGONES_SDK_GRPC_PORT")]
    agones_port: u16,
}

impl AgonesArgs {
    /// Checks that this build can do what is asked for.
    #[cfg(not(feature = "agones"))]
    pub fn check(&self) -> anyhow::Result<()> {
        anyhow::ensure!(!self.agones, "--agones needs a program that was built with --features agones");
        let _ = self.agones_port;
        Ok(())
    }

    /// Checks that this build can do what is asked for.
    #[cfg(feature = "agones")]
    pub fn check(&self) -> anyhow::Result<()> {
        Ok(())
    }

    /// Awaits the server, and reports to the sidecar meanwhile.
    #[cfg_attr(not(feature = "agones"), expect(unused_variables, reason = "nobody is told what is observed"))]
    pub async fn accompany(
        &self,
        observer: Observer,
        serving: impl Future<Output = Result<(), ServerError>>,
    ) -> anyhow::Result<()> {
        #[cfg(feature = "agones")]
        if self.agones {
            let uri = format!("http://localhost:{}", self.agones_port);
            let serving = async move { serving.await.map_err(anyhow::Error::from) };
            return surefoot_agones::run_with_sidecar(&uri, surefoot_agones::Pace::default(), observer, serving).await;
        }
        Ok(serving.await?)
    }
}
