//! `surefoot health`.

use super::endpoint::CredentialArgs;
use anyhow::{Context, anyhow};
use serde_json::json;
use std::time::Duration;
use tonic_health::pb::health_check_response::ServingStatus;
use tonic_health::pb::health_client::HealthClient;

/// Check whether a service is serving, for health checks of containers. The exit code is 0 only if it is.
#[derive(clap::Args)]
#[command(after_help = "With --json, standard output is one object, whether or not the service is serving:\n  \
        {\"uri\": STRING, \"serving\": BOOLEAN, \"status\": STATUS, \"error\": STRING or null}\n  \
        STATUS is SERVING, NOT_SERVING, SERVICE_UNKNOWN or UNKNOWN as the service answers,\n  \
        or UNREACHABLE if it does not answer; \"error\" gives the reason.\n  \
        The exit code is 0 if \"serving\" is true, otherwise 1.\n\n\
        Examples:\n  \
        surefoot health\n  \
        surefoot health http://127.0.0.1:7601 --json\n  \
        surefoot health --service surefoot.world.v1.WorldService")]
pub struct Args {
    /// URI of the service
    #[arg(default_value = "http://127.0.0.1:7600")]
    uri: String,
    /// Name of a gRPC service, which is not serving while its process has lost its lease; default: the process itself
    #[arg(long, default_value = "", hide_default_value = true, value_name = "NAME")]
    service: String,
    /// Print the result as JSON
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    credentials: CredentialArgs,
}

/// Longest wait for an answer.
const LIMIT: Duration = Duration::from_secs(2);

/// Prints the status of a service; fails unless it is serving.
pub fn run(args: &Args) -> anyhow::Result<()> {
    let dialer = args.credentials.credentials()?.dial(&args.uri)?;
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    let answer = runtime.block_on(async {
        let check = async {
            let link = dialer.connect().await.with_context(|| format!("cannot connect to {}", args.uri))?;
            let request = tonic_health::pb::HealthCheckRequest { service: args.service.clone() };
            anyhow::Ok(HealthClient::new(link).check(request).await?.into_inner().status())
        };
        tokio::time::timeout(LIMIT, check).await.context("no answer within 2 s")?
    });
    let status = answer.as_ref().map_or("UNREACHABLE", ServingStatus::as_str_name);
    let result = match answer {
        Ok(ServingStatus::Serving) => Ok(()),
        Ok(_) => Err(anyhow!("{} is {status}", args.uri)),
        Err(error) => Err(error),
    };
    match &result {
        _ if args.json => {
            let error = result.as_ref().err().map(|error| format!("{error:#}"));
            println!("{}", json!({ "uri": args.uri, "serving": result.is_ok(), "status": status, "error": error }));
        }
        Ok(()) => println!("serving"),
        Err(_) => {}
    }
    result
}
