//! Servers, and environments on them, for Python.

use crate::arrays::{StepArrays, readable, writable};
use crate::envs::{Ends, ends, points, setup};
use crate::error::{chain, state, value};
use crate::far::{FarError, FarWorlds, Server as Inner};
use crate::level::Level;
use numpy::{PyArray2, PyArrayDyn};
use pyo3::exceptions::{PyConnectionError, PyKeyboardInterrupt};
use pyo3::prelude::*;
use std::path::PathBuf;
use std::sync::{Mutex, MutexGuard};
use std::time::Duration;
use surefoot_game_client::{Game, GameError};
use surefoot_net::client::{ClientTlsFiles, Credentials};
use surefoot_net::secret::Secret;

/// Longest time for which a lost server may be sought, s.
const MOST_PATIENCE: f64 = 86_400.0;

/// A world server.
#[pyclass(frozen, module = "surefoot")]
#[derive(Debug)]
pub struct Server {
    inner: Inner,
}

impl From<FarError> for PyErr {
    fn from(error: FarError) -> Self {
        match error {
            FarError::Game(error @ (GameError::Unreachable { .. } | GameError::Gone { .. })) => {
                PyConnectionError::new_err(error.to_string())
            }
            FarError::Game(_) | FarError::NoGround(_) | FarError::Actions(_) => value(error),
            FarError::Interrupted => PyKeyboardInterrupt::new_err("interrupted while seeking the server"),
        }
    }
}

/// The address as clients of gRPC write it.
fn uri_of(text: &str) -> String {
    for (ours, theirs) in [("grpc://", "http://"), ("grpcs://", "https://")] {
        if let Some(rest) = text.strip_prefix(ours) {
            return format!("{theirs}{rest}");
        }
    }
    if text.contains("://") { text.to_owned() } else { format!("http://{text}") }
}

/// Connects to a server.
#[pyfunction]
#[pyo3(signature = (uri, *, token = None, tls_ca = None, tls_client_cert = None, tls_client_key = None, tls_server_name = None, patience = 30.0))]
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
    let game = py.detach(|| Game::connect(&uri, &credentials)).map_err(FarError::from)?;
    Ok(Server { inner: Inner { uri, credentials, patience: Duration::from_secs_f64(patience), game } })
}

#[pymethods]
impl Server {
    #[getter]
    fn uri(&self) -> &str {
        &self.inner.uri
    }

    fn __repr__(&self) -> String {
        format!("<Server {}>", self.inner.uri)
    }
}

/// Environments of a server.
#[pyclass(module = "surefoot._native")]
#[derive(Debug)]
pub struct RemoteWorlds {
    inner: Mutex<FarWorlds>,
    env_count: usize,
    observation_len: usize,
}

impl RemoteWorlds {
    fn lock(&self) -> PyResult<MutexGuard<'_, FarWorlds>> {
        self.inner.lock().map_err(|_| failed())
    }

    fn inner(&mut self) -> PyResult<&mut FarWorlds> {
        self.inner.get_mut().map_err(|_| failed())
    }

    fn shape(&self) -> [usize; 2] {
        [self.env_count, self.observation_len]
    }
}

fn failed() -> PyErr {
    state("these environments have failed in an earlier call: make new ones")
}

#[pymethods]
impl RemoteWorlds {
    #[new]
    #[expect(clippy::too_many_arguments, reason = "called by the package alone")]
    fn new(
        py: Python<'_>,
        server: Py<Server>,
        levels: Vec<Py<Level>>,
        body: &str,
        solid: bool,
        num_envs: usize,
        worlds: usize,
        goal_distance: (f32, f32),
        autoreset: &str,
        seed: u64,
    ) -> PyResult<Self> {
        let setup = setup(&levels, body, solid, (num_envs, worlds), goal_distance, autoreset)?;
        let server = server.get().inner.clone();
        let inner = py.detach(|| FarWorlds::open(server, setup, seed))?;
        Ok(Self { env_count: num_envs, observation_len: inner.observation_len(), inner: Mutex::new(inner) })
    }

    #[getter]
    fn observation_len(&self) -> usize {
        self.observation_len
    }

    fn reseed(&mut self, py: Python<'_>, seed: u64, observations: &Bound<'_, PyArrayDyn<f32>>) -> PyResult<()> {
        let mut observations = writable(observations, &self.shape(), "observations")?;
        let (rows, inner) = (observations.as_slice_mut()?, self.inner()?);
        py.detach(|| {
            inner.reseed(seed)?;
            inner.observations(rows);
            Ok(())
        })
        .map_err(|error: FarError| error.into())
    }

    fn first_observations(&self, observations: &Bound<'_, PyArrayDyn<f32>>) -> PyResult<()> {
        self.lock()?.observations(writable(observations, &self.shape(), "observations")?.as_slice_mut()?);
        Ok(())
    }

    fn renew(
        &mut self,
        py: Python<'_>,
        mask: &Bound<'_, PyArrayDyn<bool>>,
        observations: &Bound<'_, PyArrayDyn<f32>>,
    ) -> PyResult<()> {
        let mask = readable(mask, &[self.env_count], "reset_mask")?;
        if !mask.as_slice()?.iter().all(|reset| *reset) {
            return Err(value("a server resets all environments or none: leave the reset_mask out"));
        }
        let mut observations = writable(observations, &self.shape(), "observations")?;
        let (rows, inner) = (observations.as_slice_mut()?, self.inner()?);
        py.detach(|| {
            inner.renew()?;
            inner.observations(rows);
            Ok(())
        })
        .map_err(|error: FarError| error.into())
    }

    fn step<'py>(
        &mut self,
        py: Python<'py>,
        actions: &Bound<'py, PyArrayDyn<f32>>,
        observations: &Bound<'py, PyArrayDyn<f32>>,
        rewards: &Bound<'py, PyArrayDyn<f32>>,
        terminated: &Bound<'py, PyArrayDyn<bool>>,
        truncated: &Bound<'py, PyArrayDyn<bool>>,
    ) -> PyResult<Option<Ends<'py>>> {
        let (shape, inner) = (self.shape(), self.inner()?);
        let arrays = StepArrays { actions, observations, rewards, terminated, truncated };
        let go_on = || Python::attach(|py| py.check_signals().is_ok());
        let ended = arrays.lend(shape, |actions, out| py.detach(|| inner.step(actions, out, &go_on)))??;
        ends(py, ended, shape[1])
    }

    fn positions<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f32>>> {
        points(py, self.lock()?.positions())
    }

    fn goals<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f32>>> {
        let goals = self.lock()?.goals();
        let goals = goals.ok_or_else(|| value("the server drew the goals and does not tell them: use NEXT_STEP"))?;
        points(py, goals.into_iter())
    }
}
