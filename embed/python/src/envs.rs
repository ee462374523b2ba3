//! `Worlds` for Python: borrows the caller's arrays and releases the interpreter's lock while environments run.

use crate::arrays::{StepArrays, readable, rows, writable};
use crate::body;
use crate::environments::{Autoreset, EnvError, Environments, Finished, Seeds, Setup};
use crate::error::{fixed, state, value};
use crate::level::Level;
use crate::local::{LocalWorlds, open_world};
use crate::remote::RemoteWorlds;
use crate::server::Server;
use crate::threads::core_count;
use numpy::{IntoPyArray, PyArray1, PyArray2, PyArrayDyn, PyArrayMethods};
use pyo3::prelude::*;
use std::f32::consts::TAU;
use std::sync::{Arc, Mutex, MutexGuard};
use std::time::Instant;
use surefoot_rollout::env::{Env, Episodes, Route, actions_of};
use surefoot_world::character::ACTION_LEN;
use surefoot_world::{Map, Vec3};

/// Most environments of one object.
const MAX_ENVS: usize = 65_536;
/// Most threads of one object.
const MAX_THREADS: usize = 1024;
/// Greatest distance of a goal, m.
const MAX_GOAL_M: f32 = 1500.0;
/// Largest coordinate, m.
const MOST_M: f32 = 1.0e6;

/// Indices, ends and last observations of the episodes that ended.
type Ends<'py> = (Bound<'py, PyArray1<i64>>, Vec<&'static str>, Bound<'py, PyArray2<f32>>);

/// Environments of this process or of a server.
#[pyclass(module = "surefoot._native")]
pub struct Worlds {
    // One thread at a time uses the environments.
    inner: Mutex<Box<dyn Environments>>,
    env_count: usize,
    observation_len: usize,
}

impl Worlds {
    fn lock(&self) -> PyResult<MutexGuard<'_, Box<dyn Environments>>> {
        self.inner.lock().map_err(|_| failed())
    }

    fn inner(&mut self) -> PyResult<&mut dyn Environments> {
        Ok(self.inner.get_mut().map_err(|_| failed())?.as_mut())
    }

    fn shape(&self) -> [usize; 2] {
        [self.env_count, self.observation_len]
    }
}

/// Seed of all environments, or of each.
#[derive(FromPyObject)]
enum SeedOrSeeds {
    One(u64),
    Each(Vec<u64>),
}

fn failed() -> PyErr {
    state("these environments have failed in an earlier call: make new ones")
}

/// Reads the arguments that all kinds of environments share.
fn setup(
    levels: &[Py<Level>],
    body: &str,
    solid: bool,
    (env_count, world_count): (usize, usize),
    band: (f32, f32),
    autoreset: &str,
) -> PyResult<Setup> {
    if levels.is_empty() {
        return Err(value("level is empty: give at least one"));
    }
    in_range("num_envs", env_count, MAX_ENVS)?;
    in_range("worlds", world_count, env_count)?;
    let (nearest, farthest) = band;
    if !(0.0..=MAX_GOAL_M).contains(&nearest) || !(nearest..=MAX_GOAL_M).contains(&farthest) {
        return Err(value(format!(
            "goal_distance is ({nearest}, {farthest}), but must be two distances in ascending order, \
             0 to {MAX_GOAL_M} m"
        )));
    }
    let autoreset = match autoreset {
        "NextStep" => Autoreset::NextStep,
        "SameStep" => Autoreset::SameStep,
        "Disabled" => Autoreset::Disabled,
        other => return Err(value(format!("there is no autoreset mode {other}: NextStep, SameStep or Disabled"))),
    };
    let levels: Vec<Arc<Map>> = levels.iter().map(|level| level.get().map.clone()).collect();
    Ok(Setup { levels, body: body::read(body)?, solid, band, env_count, world_count, autoreset })
}

fn in_range(name: &str, found: usize, most: usize) -> PyResult<()> {
    if (1..=most).contains(&found) { Ok(()) } else { Err(value(format!("{name} is {found}, but must be 1 to {most}"))) }
}

/// Episodes that ended, as arrays; `None` if there are none.
fn ends<'py>(py: Python<'py>, ended: Vec<Finished>, observation_len: usize) -> PyResult<Option<Ends<'py>>> {
    if ended.is_empty() {
        return Ok(None);
    }
    let indices: Vec<i64> = ended.iter().map(|end| end.env as i64).collect();
    let names = ended.iter().map(|end| end.outcome).collect();
    let count = ended.len();
    let rows: Vec<f32> = ended.into_iter().flat_map(|end| end.last).collect();
    let rows = rows.into_pyarray(py).reshape([count, observation_len])?;
    Ok(Some((indices.into_pyarray(py), names, rows)))
}

/// Points as an array of three columns.
pub fn points<'py>(py: Python<'py>, points: impl Iterator<Item = Vec3>) -> PyResult<Bound<'py, PyArray2<f32>>> {
    rows(py, points.map(|point| point.to_array()))
}

/// A place on a level, m.
pub fn place(name: &str, [x, y, z]: [f32; 3]) -> PyResult<Vec3> {
    if [x, y, z].iter().all(|value| value.abs() <= MOST_M) {
        return Ok(Vec3::new(x, y, z));
    }
    Err(value(format!("{name} is ({x}, {y}, {z}): all three must be finite, and at most a million")))
}

#[pymethods]
impl Worlds {
    #[new]
    #[expect(clippy::too_many_arguments, reason = "called by the package alone")]
    fn new(
        py: Python<'_>,
        levels: Vec<Py<Level>>,
        body: &str,
        solid: bool,
        num_envs: usize,
        worlds: usize,
        goal_distance: (f32, f32),
        autoreset: &str,
        seed: u64,
        threads: Option<usize>,
        server: Option<Py<Server>>,
    ) -> PyResult<Self> {
        let setup = setup(&levels, body, solid, (num_envs, worlds), goal_distance, autoreset)?;
        let observation_len = setup.observation_len();
        let inner: Box<dyn Environments> = if let Some(server) = server {
            let link = server.get().link.clone();
            Box::new(py.detach(|| RemoteWorlds::open(link, setup, seed))?)
        } else {
            let (seeds, threads) = (Seeds::Worlds(seed), threads.unwrap_or_else(|| core_count().min(MAX_THREADS)));
            in_range("threads", threads, MAX_THREADS)?;
            Box::new(py.detach(|| LocalWorlds::open(setup, &seeds, threads)).map_err(value)?)
        };
        Ok(Self { env_count: num_envs, observation_len, inner: Mutex::new(inner) })
    }

    #[getter]
    fn observation_len(&self) -> usize {
        self.observation_len
    }

    /// Starts again with one seed for each environment, or with one seed for all.
    fn reseed(&mut self, py: Python<'_>, seed: SeedOrSeeds, observations: &Bound<'_, PyArrayDyn<f32>>) -> PyResult<()> {
        let seeds = match seed {
            SeedOrSeeds::One(seed) => Seeds::Worlds(seed),
            SeedOrSeeds::Each(seeds) if seeds.len() == self.env_count => Seeds::Envs(seeds),
            SeedOrSeeds::Each(seeds) => {
                let (found, count) = (seeds.len(), self.env_count);
                return Err(value(format!("seed has {found} values, but there are {count} environments")));
            }
        };
        let mut observations = writable(observations, &self.shape(), "observations")?;
        let (rows, inner) = (observations.as_slice_mut()?, self.inner()?);
        py.detach(|| {
            inner.reseed(seeds)?;
            inner.observations(rows);
            Ok(())
        })
        .map_err(|error: EnvError| error.into())
    }

    /// Writes the observations of environments that have not been stepped yet.
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
        let mut observations = writable(observations, &self.shape(), "observations")?;
        let (mask, rows, inner) = (mask.as_slice()?, observations.as_slice_mut()?, self.inner()?);
        Ok(py.detach(|| inner.renew(mask, rows))?)
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
        let goes_on = || Python::attach(|py| py.check_signals().is_ok());
        let ended = arrays.lend(shape, |actions, out| py.detach(|| inner.step(actions, out, &goes_on)))??;
        ends(py, ended, shape[1])
    }

    /// Gives an environment new waypoints, and writes its observation.
    #[pyo3(signature = (env, waypoints, start, yaw, observations))]
    fn redirect(
        &mut self,
        env: usize,
        waypoints: Vec<[f32; 3]>,
        start: Option<[f32; 3]>,
        yaw: f32,
        observations: &Bound<'_, PyArrayDyn<f32>>,
    ) -> PyResult<()> {
        let [count, len] = self.shape();
        if env >= count {
            return Err(value(format!("there is no environment {env}: 0 to {}", count - 1)));
        }
        if waypoints.is_empty() {
            return Err(value("waypoints is empty: give at least one place"));
        }
        if !(-TAU..=TAU).contains(&yaw) {
            return Err(value(format!("yaw is {yaw}, but must be -2 pi to 2 pi")));
        }
        if start.is_none() && self.lock()?.rests().is_some_and(|rests| rests[env]) {
            return Err(state(format!("the episode of environment {env} has ended: give a start, or reset it")));
        }
        let waypoints = waypoints.into_iter().map(|it| place("waypoints", it)).collect::<PyResult<_>>()?;
        let start = start.map(|it| place("start", it)).transpose()?.map(|feet| (feet, yaw));
        let mut observations = writable(observations, &[count, len], "observations")?;
        let row = &mut observations.as_slice_mut()?[env * len..][..len];
        Ok(self.inner()?.redirect(&Route { npc_idx: env, start, waypoints }, row)?)
    }

    fn positions<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f32>>> {
        points(py, self.lock()?.positions().into_iter())
    }

    fn goals<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f32>>> {
        let goals = self.lock()?.goals();
        points(
            py,
            goals
                .ok_or_else(|| value("the server drew the goals and does not report them: use NEXT_STEP"))?
                .into_iter(),
        )
    }

    fn rests<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray1<bool>>> {
        let rests = self.lock()?.rests();
        Ok(rests.ok_or_else(|| value("a server does not report which environments wait"))?.into_pyarray(py))
    }

    fn __reduce__(&self) -> PyResult<()> {
        Err(fixed("environments cannot be copied or pickled: make others with the same arguments and seed"))
    }
}

/// Environments of one world that Rust steps without Python, for `bench.py`.
#[pyclass(module = "surefoot._native")]
#[derive(Debug)]
pub struct RustOnly {
    env: Mutex<Env>,
}

#[pymethods]
impl RustOnly {
    #[new]
    fn new(py: Python<'_>, level: Py<Level>, num_envs: usize, goal_distance: (f32, f32), seed: u64) -> PyResult<Self> {
        let setup = setup(&[level], "surefoot", false, (num_envs, 1), goal_distance, "SameStep")?;
        let episodes = Episodes::Endless { npc_count: num_envs, band: goal_distance, seed };
        Ok(Self { env: Mutex::new(py.detach(|| open_world(&setup, 0, episodes)).map_err(value)?) })
    }

    /// Duration of `steps` steps with these actions, s.
    fn seconds(&mut self, py: Python<'_>, actions: &Bound<'_, PyArrayDyn<f32>>, steps: usize) -> PyResult<f64> {
        let env = self.env.get_mut().map_err(|_| failed())?;
        let actions = readable(actions, &[env.npc_count(), ACTION_LEN], "actions")?;
        let actions = actions_of(actions.as_slice()?, |idx| idx as u64).map_err(value)?;
        Ok(py.detach(|| {
            let started = Instant::now();
            for _ in 0..steps {
                env.step(&actions);
            }
            started.elapsed().as_secs_f64()
        }))
    }
}
