//! Flags for both ends of a connection: limits and security of a service, credentials of a client.

use anyhow::{anyhow, bail};
use std::net::SocketAddr;
use std::path::PathBuf;
use std::time::Duration;
use surefoot_net::client::{ClientTlsFiles, Credentials};
use surefoot_net::secret::Secret;
use surefoot_net::serving::security::ServerTls;
use surefoot_net::serving::tokens::Tokens;
use surefoot_net::serving::{Endpoint, EndpointConfig, Limits, Security, ServeError};

/// Binds the `address` that `flag` gave.
pub fn open(flag: &str, address: SocketAddr, config: EndpointConfig) -> anyhow::Result<Endpoint> {
    Endpoint::open(address, config).map_err(|error| match &error {
        ServeError::Bind { source, .. } => anyhow!("{error}: {source}: give another address with {flag}"),
        _ => error.into(),
    })
}

/// Limits and security of a service.
#[derive(clap::Args)]
#[command(next_help_heading = "Limits and security")]
pub struct EndpointArgs {
    /// Size limit of a request
    #[arg(long, default_value_t = Limits::default().max_message_bytes, value_name = "BYTES")]
    max_message_bytes: usize,
    /// Size limit of a request that imports a level
    #[arg(long, default_value_t = Limits::default().max_import_bytes, value_name = "BYTES")]
    max_import_bytes: usize,
    /// Most open streams per connection
    #[arg(long, default_value_t = Limits::default().max_streams, value_name = "N")]
    max_streams: u32,
    /// Most connections at a time; a further one takes the place of the oldest one that has made no authorized request,
    /// and is closed if there is none
    #[arg(long, default_value_t = Limits::default().max_connections, value_name = "N")]
    max_connections: usize,
    /// Close a new connection that sends nothing for this long
    #[arg(long, default_value_t = Seconds(Limits::default().handshake_timeout), value_name = "SECONDS")]
    handshake_timeout: Seconds,
    /// Close a connection that carries no data in either direction for this long
    #[arg(long, default_value_t = Seconds(Limits::default().idle_timeout), value_name = "SECONDS")]
    idle_timeout: Seconds,
    /// Deadline of calls whose client sets none; it does not apply to streams
    #[arg(long, default_value_t = Seconds(Limits::default().default_deadline), value_name = "SECONDS")]
    default_deadline: Seconds,
    /// Longest deadline that a client may set on a call
    #[arg(long, default_value_t = Seconds(Limits::default().max_deadline), value_name = "SECONDS")]
    max_deadline: Seconds,
    /// Interval between keepalive pings
    #[arg(long, default_value_t = Seconds(Limits::default().keepalive_interval), value_name = "SECONDS")]
    keepalive_interval: Seconds,
    /// Close a connection whose peer does not answer a ping for this long
    #[arg(long, default_value_t = Seconds(Limits::default().keepalive_timeout), value_name = "SECONDS")]
    keepalive_timeout: Seconds,
    /// Certificate chain for TLS, PEM
    #[arg(long, value_name = "FILE")]
    tls_cert: Option<PathBuf>,
    /// Private key of --tls-cert, PEM
    #[arg(long, value_name = "FILE")]
    tls_key: Option<PathBuf>,
    /// Require clients to present a certificate issued by this authority, PEM
    #[arg(long, value_name = "FILE")]
    tls_client_ca: Option<PathBuf>,
    /// Serve other machines without TLS
    #[arg(long)]
    insecure: bool,
    /// TOML file of [[token]] entries with name, role (client, worker, designer or admin) and secret; every call then
    /// requires a token
    #[arg(long, value_name = "FILE")]
    tokens: Option<PathBuf>,
    /// Origins of web pages on other hosts that may call this service, such as https://studio.example, separated by
    /// commas
    #[arg(long, value_name = "ORIGIN", value_delimiter = ',')]
    allow_origin: Vec<String>,
}

impl EndpointArgs {
    /// Checks the flags and reads the certificate, key and token files.
    pub fn config(&self) -> anyhow::Result<EndpointConfig> {
        if self.max_connections == 0 || self.max_streams == 0 {
            bail!("--max-connections and --max-streams must be at least 1");
        }
        let limits = Limits {
            max_message_bytes: self.max_message_bytes,
            max_import_bytes: self.max_import_bytes,
            max_streams: self.max_streams,
            max_connections: self.max_connections,
            handshake_timeout: self.handshake_timeout.0,
            idle_timeout: self.idle_timeout.0,
            default_deadline: self.default_deadline.0,
            max_deadline: self.max_deadline.0,
            keepalive_interval: self.keepalive_interval.0,
            keepalive_timeout: self.keepalive_timeout.0,
        };
        let tls = match (&self.tls_cert, &self.tls_key) {
            (Some(certificate), Some(key)) => Some(ServerTls::load(certificate, key, self.tls_client_ca.as_deref())?),
            (None, None) if self.tls_client_ca.is_some() => bail!("--tls-client-ca needs --tls-cert and --tls-key"),
            (None, None) => None,
            _ => bail!("--tls-cert and --tls-key must be given together"),
        };
        let tokens = self.tokens.as_deref().map(Tokens::load).transpose()?;
        Ok(EndpointConfig {
            limits,
            security: Security { tls, tokens, insecure: self.insecure, origins: self.allow_origin.clone() },
        })
    }
}

/// The credentials of a client, and the authorities that it trusts.
#[derive(clap::Args, Clone)]
#[command(next_help_heading = "Credentials")]
pub struct CredentialArgs {
    /// Secret of a token. The environment variable and --token-file keep it out of the process list
    #[arg(long, value_name = "SECRET", value_parser = parse_secret, env = "SUREFOOT_TOKEN", hide_env_values = true)]
    token: Option<Secret>,
    /// File with the secret of a token
    #[arg(long, value_name = "FILE", env = "SUREFOOT_TOKEN_FILE")]
    token_file: Option<PathBuf>,
    /// Authority that issued the certificates of services at https://, PEM; default: the system's authorities
    #[arg(long, value_name = "FILE", env = "SUREFOOT_TLS_CA")]
    tls_ca: Option<PathBuf>,
    /// Client certificate for services that request one, PEM
    #[arg(long, value_name = "FILE", env = "SUREFOOT_TLS_CLIENT_CERT")]
    tls_client_cert: Option<PathBuf>,
    /// Private key of --tls-client-cert, PEM
    #[arg(long, value_name = "FILE", env = "SUREFOOT_TLS_CLIENT_KEY")]
    tls_client_key: Option<PathBuf>,
    /// Expected host name in the certificates of services; default: the host of their URI
    #[arg(long, value_name = "NAME", env = "SUREFOOT_TLS_SERVER_NAME")]
    tls_server_name: Option<String>,
}

fn parse_secret(text: &str) -> Result<Secret, std::convert::Infallible> {
    Ok(Secret::new(text))
}

impl CredentialArgs {
    /// Reads the certificate, key and token files.
    pub fn credentials(&self) -> anyhow::Result<Credentials> {
        let identity = match (&self.tls_client_cert, &self.tls_client_key) {
            (Some(certificate), Some(key)) => Some((certificate.clone(), key.clone())),
            (None, None) => None,
            _ => bail!("--tls-client-cert and --tls-client-key must be given together"),
        };
        let files =
            ClientTlsFiles { authority: self.tls_ca.clone(), identity, server_name: self.tls_server_name.clone() };
        match (&self.token, &self.token_file) {
            (Some(_), Some(_)) => bail!("--token and --token-file cannot be given together"),
            (token, None) => Ok(Credentials::load(token.as_ref(), &files)?),
            (None, Some(path)) => Ok(Credentials::load_with_token_file(path, &files)?),
        }
    }

    /// Whether a token is configured, by flag, variable or file.
    pub fn has_token(&self) -> bool {
        self.token.is_some() || self.token_file.is_some()
    }
}

/// A duration, written in seconds on the command line.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Seconds(Duration);

impl std::fmt::Display for Seconds {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}", self.0.as_secs_f64())
    }
}

impl std::str::FromStr for Seconds {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let seconds: f64 = text.parse().map_err(|_| "not a number of seconds".to_owned())?;
        if !(0.001..=1.0e6).contains(&seconds) {
            return Err("allowed are 0.001 to 1000000 seconds".to_owned());
        }
        Ok(Self(Duration::from_secs_f64(seconds)))
    }
}
