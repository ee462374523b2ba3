//! World servers for Python.

use crate::environments::EnvError;
use crate::error::{chain, fixed, value};
use crate::remote::ServerLink;
use pyo3::exceptions::{PyConnectionError, PyKeyboardInterrupt};
use pyo3::prelude::*;
use std::path::PathBuf;
use std::time::Duration;
use surefoot_game_client::{Game, GameError};
use surefoot_net::client::{ClientTlsFiles, Credentials};
use surefoot_net::secret::Secret;

/// Longest `patience`, s.
const MOST_PATIENCE: f64 = 86_400.0;

/// A world server.
#[pyclass(frozen, module = "surefoot")]
#[derive(Debug)]
pub struct Server {
    pub link: ServerLink,
}

impl From<EnvError> for PyErr {
    fn from(error: EnvError) -> Self {
        match error {
            EnvError::Game(error @ (GameError::Unreachable { .. } | GameError::Gone { .. })) => {
                PyConnectionError::new_err(error.to_string())
            }
            EnvError::Game(_) | EnvError::NoGround(_) | EnvError::Argument(_) => value(error),
            EnvError::Interrupted => PyKeyboardInterrupt::new_err("interrupted while waiting for the server"),
        }
    }
}

/// The address in the form that gRPC clients expect.
fn uri_of(text: &str) -> String {
    for (ours, theirs) in [("grpc://", "http://"), ("grpcs://", "https://")] {
        if let Some(rest) = text.strip_prefix(ours) {
            return format!("{theirs}{rest}");
        }
    }
    if text.contains("://") { text.to_owned() } else { format!("http://{text}") }
}

/// Says which arguments a certificate depends on.
fn explained(error: GameError) -> GameError {
    match error {
        GameError::Unreachable { uri, reason } if reason.contains("certificate") => {
            let reason = format!("{reason} (tls_ca is its authority, and tls_server_name the name in it)");
            GameError::Unreachable { uri, reason }
        }
        other => other,
    }
}

/// Connects to a server.
#[pyfunction]
#[pyo3(signature = (
    uri, *, token = None, tls_ca = None, tls_client_cert = None, tls_client_key = None, tls_server_name = None,
    patience = 30.0
))]
#[expect(clippy::too_many_arguments, reason = "keyword arguments of Python")]
pub fn connect(
    py: Python<'_>,
    uri: &str,
    token: Option<String>,
    tls_ca: Option<PathBuf>,
    tls_client_cert: Option<PathBuf>,
    tls_client_key: Option<PathBuf>,
    tls_server_name: Option<String>,
    patience: f64,
) -> PyResult<Server> {
    if !(0.0..=MOST_PATIENCE).contains(&patience) {
        return Err(value(format!("patience is {patience}, but must be 0 to {MOST_PATIENCE} s")));
    }
    let identity = match (tls_client_cert, tls_client_key) {
        (Some(certificate), Some(key)) => Some((certificate, key)),
        (None, None) => None,
        _ => return Err(value("tls_client_cert and tls_client_key must be given together")),
    };
    let files = ClientTlsFiles { authority: tls_ca, identity, server_name: tls_server_name };
    let token = token.map(Secret::new);
    let credentials = Credentials::load(token.as_ref(), &files).map_err(|error| value(chain(&error)))?;
    let uri = uri_of(uri);
    let game = py.detach(|| Game::connect(&uri, &credentials)).map_err(|error| EnvError::from(explained(error)))?;
    Ok(Server { link: ServerLink { uri, credentials, patience: Duration::from_secs_f64(patience), game } })
}

#[pymethods]
impl Server {
    #[getter]
    fn uri(&self) -> &str {
        &self.link.uri
    }

    fn __reduce__(&self) -> PyResult<()> {
        Err(fixed("connections cannot be copied or pickled: call connect in the other process"))
    }

    fn __repr__(&self) -> String {
        format!("<Server {}>", self.link.uri)
    }
}
