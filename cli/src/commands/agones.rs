//! `surefoot serve --agones`.

use surefoot_server::ServerError;
use surefoot_server::observer::Observer;

/// Flags of a server that Agones runs.
#[derive(clap::Args)]
#[command(next_help_heading = "Agones")]
pub struct AgonesArgs {
    /// Run as a game server of Agones: report state, health, and counters of worlds and NPCs to the sidecar on this
    /// machine
    #[arg(long)]
    agones: bool,
    /// Port at which the sidecar serves gRPC
    #[arg(long, default_value_t = 9357, value_name = "PORT", env = "AGONES_SDK_GRPC_PORT")]
    agones_port: u16,
}

impl AgonesArgs {
    /// Checks that this build supports the flags.
    pub fn check(&self) -> anyhow::Result<()> {
        // Without the feature, nothing else reads the port.
        let _ = self.agones_port;
        let is_supported = cfg!(feature = "agones") || !self.agones;
        anyhow::ensure!(is_supported, "--agones needs a program that was built with --features agones");
        Ok(())
    }

    /// Runs the server to its end, and reports to the sidecar meanwhile.
    #[cfg_attr(not(feature = "agones"), expect(unused_variables, reason = "without the feature there is no sidecar"))]
    pub async fn run_with_sidecar(
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
