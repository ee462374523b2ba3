//! `surefoot health`.

use super::endpoint::CredentialArgs;
use anyhow::{Context, bail};
use std::time::Duration;
use tonic_health::pb::health_check_response::ServingStatus;
use tonic_health::pb::health_client::HealthClient;

/// Ask a service whether it is serving; exits non-zero if not. Meant for container health checks.
#[derive(clap::Args)]
#[command(after_help = "Examples:\n  surefoot health\n  surefoot health http://127.0.0.1:7601\n  \
        surefoot health --service surefoot.world.v1.WorldService")]
pub struct Args {
    /// URI of the service
    #[arg(default_value = "http://127.0.0.1:7600")]
    uri: String,
    /// Service to ask about: it is not serving while its process has lost its lease; default: the process
    #[arg(long, default_value = "", hide_default_value = true, value_name = "NAME")]
    service: String,
    #[command(flatten)]
    credentials: CredentialArgs,
}

pub fn run(args: &Args) -> anyhow::Result<()> {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    runtime.block_on(async {
        let dialer = args.credentials.credentials()?.dial(&args.uri)?;
        let check = async {
            let link = dialer.connect().await.with_context(|| format!("cannot connect to {}", args.uri))?;
            let request = tonic_health::pb::HealthCheckRequest { service: args.service.clone() };
            anyhow::Ok(HealthClient::new(link).check(request).await?.into_inner().status())
        };
        let status = tokio::time::timeout(Duration::from_secs(2), check).await.context("no answer within 2 s")??;
        if status != ServingStatus::Serving {
            bail!("{} is {}", args.uri, status.as_str_name());
        }
        println!("serving");
        Ok(())
    })
}
