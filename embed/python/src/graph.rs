//! Graphs of levels, and plans.

use crate::body::Figures;
use crate::envs::{place, points};
use crate::error::{chain, file, value};
use crate::level::Level;
use crate::picture;
use crate::plan::{Arrival, Plan};
use crate::policy::Policy;
use crate::threads::{core_count, with_own_threads};
use crate::zone;
use numpy::{PyArray1, PyArray2};
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict};
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;
use surefoot_planner::export::{About, Format, export_about, frame_of, import_json};
use surefoot_planner::reachability;
use surefoot_planner::search::DEFAULT_LABEL_LIMIT;
use surefoot_planner::search::many::{self, RankBy, SharedEnd};
use surefoot_planner::{
    ABILITY_PRICES, AbilityPrices, AbilitySet, BuildError, BuildSettings, Built, Caution, EdgeCosts, NavGraph,
    Progress, Query, Router, VertexId,
};
use surefoot_report::render::View;
use surefoot_rollout::{ProbeContext, graphs};
use surefoot_world::map::LevelFrame;
use surefoot_world::{Ability, DECISION_SECONDS, DVec3, Map, Seconds, Vec3};

/// Interval at which a build checks for an interrupt.
const LOOK_EVERY: Duration = Duration::from_millis(50);

/// A graph of a level whose edges were proved, ready for queries.
#[pyclass(frozen, module = "surefoot")]
#[derive(Debug)]
pub struct Graph {
    router: Router,
    map: Option<Arc<Map>>,
    /// How the level's own coordinates relate to the map's, if that is known.
    frame: Option<LevelFrame>,
}

/// Indices of vertices, and a time for each, s.
type VertexTimes<'py> = (Bound<'py, PyArray1<u32>>, Bound<'py, PyArray1<f32>>);

/// A constructor, and its arguments.
type Reduced<'py> = (Bound<'py, PyAny>, (String, Option<Level>));

/// Builds a graph, and calls `progress` with the numbers of finished and of known probes.
fn build(
    py: Python<'_>,
    context: &ProbeContext,
    settings: &BuildSettings,
    threads: usize,
    report: Option<&Bound<'_, PyAny>>,
) -> PyResult<Built> {
    let progress = Progress::default();
    std::thread::scope(|scope| {
        let builder = scope.spawn(|| with_own_threads(|| graphs::build(context, settings, threads, &progress)));
        while !builder.is_finished() {
            py.detach(|| std::thread::sleep(LOOK_EVERY));
            let seen = (progress.done.load(Ordering::Relaxed), progress.total.load(Ordering::Relaxed));
            let told = py.check_signals().and_then(|()| report.map_or(Ok(()), |call| call.call1(seen).map(drop)));
            if let Err(error) = told {
                progress.cancel.store(true, Ordering::Relaxed);
                py.detach(|| builder.join()).ok();
                return Err(error);
            }
        }
        builder.join().expect("a build does not panic").map_err(|error: BuildError| value(chain(&error)))
    })
}

impl Graph {
    fn of(graph: NavGraph, map: Option<Arc<Map>>, frame: Option<LevelFrame>, threads: usize) -> Self {
        let frame = map.as_ref().map(|map| *map.frame()).or(frame);
        let router = with_own_threads(|| Router::new(graph, DEFAULT_LABEL_LIMIT, threads));
        Self { router, map, frame }
    }

    /// The frame of a query with this keyword; `None` for the coordinates of the map.
    fn frame_of(&self, coordinates: &str) -> PyResult<Option<LevelFrame>> {
        match coordinates {
            "map" => Ok(None),
            "level" => match self.frame {
                Some(frame) => Ok(Some(frame)),
                None => Err(value("the graph does not say where its level lies: pass the level to Graph.load")),
            },
            other => Err(value(format!("coordinates is {other}, but must be map or level"))),
        }
    }

    fn graph(&self) -> &NavGraph {
        self.router.graph()
    }

    /// The content of a file of the graph.
    fn to_text(&self) -> String {
        export_about(self.graph(), Format::Json, About { frame: self.frame, body: None })
    }
}

/// A place of a query on the map; `frame` is that of its coordinates, `None` for the map's.
fn on_map(name: &str, at: [f64; 3], frame: Option<LevelFrame>) -> PyResult<Vec3> {
    let at = DVec3::from_array(at);
    place(name, frame.map_or(at.as_vec3(), |frame| frame.to_map(at)).to_array())
}

/// What the abilities cost that a query names, s.
type Prices = BTreeMap<String, f32>;

fn query(
    graph: &NavGraph,
    [start, goal]: [Vec3; 2],
    without: &[String],
    prices: &Prices,
    caution: f32,
) -> PyResult<Query> {
    let ability = |name: &String| {
        graph.ability_named(name).filter(|ability| *ability != Ability::WALK).ok_or_else(|| {
            let names: Vec<&str> = graph.abilities().skip(1).map(|(_, name)| name).collect();
            value(format!("there is no ability {name} to rule out or to price: there are {}", names.join(", ")))
        })
    };
    let mut priced = AbilityPrices::default();
    for (name, price) in prices {
        if !priced.add(ability(name)?, Seconds(*price)) {
            let (least, most) = ABILITY_PRICES.into_inner();
            return Err(value(format!("the price of {name} is {price}, but must be {least} to {most} s")));
        }
    }
    Ok(Query {
        prices: priced,
        without: without.iter().map(ability).collect::<PyResult<AbilitySet>>()?,
        caution: Caution::new(caution).ok_or_else(|| value(format!("caution is {caution}, but must be 0 to 1")))?,
        ..Query::new(start, goal)
    })
}

#[pymethods]
impl Graph {
    #[staticmethod]
    #[pyo3(signature = (
        level, body = Figures::default(), *, policy = None, vertices = 300, seed = 0, threads = None, progress = None
    ))]
    #[expect(clippy::too_many_arguments, reason = "keyword arguments of Python")]
    fn build(
        py: Python<'_>,
        level: Py<Level>,
        body: Figures<'_>,
        policy: Option<Py<Policy>>,
        vertices: usize,
        seed: u64,
        threads: Option<usize>,
        progress: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let settings = BuildSettings::default();
        let settings = settings.with(|it| (it.vertices, it.seed) = (vertices, seed));
        let settings = settings.map_err(|error| value(chain(&error)))?;
        let threads = threads.unwrap_or_else(core_count);
        if threads == 0 {
            return Err(value("threads is 0, but must be 1 or more"));
        }
        let policy = match policy {
            Some(policy) => policy.get().inner.clone(),
            None => Policy::open("general-reactive", 0)?.inner,
        };
        let map = level.get().map.clone();
        let context = ProbeContext { map: map.clone(), profile: body.profile(py)?, policy };
        let built = build(py, &context, &settings, threads, progress)?;
        Ok(py.detach(|| Self::of(built.graph, Some(map), None, threads)))
    }

    #[staticmethod]
    #[pyo3(signature = (path, level = None))]
    fn load(py: Python<'_>, path: PathBuf, level: Option<Py<Level>>) -> PyResult<Self> {
        let text = std::fs::read_to_string(&path).map_err(|error| match error.kind() {
            std::io::ErrorKind::InvalidData => value(format!("{}: this is not a graph", path.display())),
            _ => file(&path, &error),
        })?;
        Self::_of_text(py, &text, level).map_err(|error| value(format!("{}: {}", path.display(), error.value(py))))
    }

    fn save(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        py.detach(|| std::fs::write(&path, self.to_text())).map_err(|error| file(&path, &error))
    }

    /// The graph of the content of a file, for unpickling.
    #[staticmethod]
    fn _of_text(py: Python<'_>, text: &str, level: Option<Py<Level>>) -> PyResult<Self> {
        let graph = import_json(text).map_err(|error| value(chain(&error)))?;
        let map = level.map(|level| level.get().map.clone());
        Ok(py.detach(|| Self::of(graph, map, frame_of(text), 1)))
    }

    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<Reduced<'py>> {
        let (graph, py) = (slf.get(), slf.py());
        let level = graph.map.clone().map(Level::from);
        Ok((slf.get_type().getattr("_of_text")?, (py.detach(|| graph.to_text()), level)))
    }

    fn __copy__(slf: Py<Self>) -> Py<Self> {
        slf
    }

    fn __deepcopy__(slf: Py<Self>, _memo: &Bound<'_, PyAny>) -> Py<Self> {
        slf
    }

    #[pyo3(signature = (
        start, goal, *, without = Vec::new(), prices = Prices::new(), caution = 1.0, coordinates = "map",
        zones = Vec::new(), tags = Vec::new()
    ))]
    #[expect(clippy::too_many_arguments, reason = "keyword arguments in Python")]
    fn plan(
        &self,
        py: Python<'_>,
        start: [f64; 3],
        goal: [f64; 3],
        without: Vec<String>,
        prices: Prices,
        caution: f32,
        coordinates: &str,
        zones: Vec<Bound<'_, PyDict>>,
        tags: Vec<String>,
    ) -> PyResult<Plan> {
        let frame = self.frame_of(coordinates)?;
        let ends = [on_map("start", start, frame)?, on_map("goal", goal, frame)?];
        let query = Query {
            zones: zone::read(py, &zones, frame)?,
            tags: zone::read_tags(tags)?,
            ..query(self.graph(), ends, &without, &prices, caution)?
        };
        Ok(Plan::of(&py.detach(|| self.router.find_path(&query)), self.graph(), frame))
    }

    #[pyo3(signature = (
        places, *, start = None, goal = None, by = "cost", best = None, without = Vec::new(),
        prices = Prices::new(), caution = 1.0, coordinates = "map"
    ))]
    #[expect(clippy::too_many_arguments, reason = "keyword arguments of Python")]
    fn rank(
        &self,
        py: Python<'_>,
        places: Vec<[f64; 3]>,
        start: Option<[f64; 3]>,
        goal: Option<[f64; 3]>,
        by: &str,
        best: Option<usize>,
        without: Vec<String>,
        prices: Prices,
        caution: f32,
        coordinates: &str,
    ) -> PyResult<Vec<Arrival>> {
        let frame = self.frame_of(coordinates)?;
        let (shared, end) = match (start, goal) {
            (Some(start), None) => (SharedEnd::Start, on_map("start", start, frame)?),
            (None, Some(goal)) => (SharedEnd::Goal, on_map("goal", goal, frame)?),
            _ => return Err(value("either start or goal must be given")),
        };
        let query = query(self.graph(), [end; 2], &without, &prices, caution)?;
        let by: RankBy = by.parse().map_err(|_| value(format!("by is {by}, but must be cost or seconds")))?;
        let places =
            places.into_iter().map(|place| on_map("a place", place, frame)).collect::<PyResult<Vec<Vec3>>>()?;
        let arrivals = py.detach(|| self.router.arrivals(&query, shared, &places, &EdgeCosts::new()));
        let order = many::best(&arrivals, by, best.unwrap_or(usize::MAX));
        Ok(order.into_iter().map(|idx| Arrival::of(idx, &arrivals[idx])).collect())
    }

    #[pyo3(signature = (
        start, seconds, *, without = Vec::new(), prices = Prices::new(), caution = 1.0, coordinates = "map"
    ))]
    #[expect(clippy::too_many_arguments, reason = "keyword arguments of Python")]
    fn reachable<'py>(
        &self,
        py: Python<'py>,
        start: [f64; 3],
        seconds: f32,
        without: Vec<String>,
        prices: Prices,
        caution: f32,
        coordinates: &str,
    ) -> PyResult<VertexTimes<'py>> {
        let start = on_map("start", start, self.frame_of(coordinates)?)?;
        let query = query(self.graph(), [start; 2], &without, &prices, caution)?;
        let reached = py.detach(|| self.router.reachable(&query, Seconds(seconds), &EdgeCosts::new()));
        let vertices = reached.iter().map(|reached| reached.vertex.0).collect();
        let times = reached.iter().map(|reached| reached.seconds.0).collect();
        Ok((PyArray1::from_vec(py, vertices), PyArray1::from_vec(py, times)))
    }

    /// Positions of the vertices, m.
    #[getter]
    fn vertices<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f32>>> {
        let graph = self.graph();
        points(py, graph.vertices().map(|vertex| graph.position(vertex)))
    }

    fn __len__(&self) -> usize {
        self.graph().vertex_count()
    }

    #[getter]
    fn edge_count(&self) -> usize {
        self.graph().edge_count()
    }

    fn to_networkx<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let networkx = py.import("networkx").map_err(|error| {
            let missing = pyo3::exceptions::PyImportError::new_err("this needs NetworkX: pip install networkx");
            missing.set_cause(py, Some(error));
            missing
        })?;
        let directed = networkx.getattr("DiGraph")?.call0()?;
        let graph = self.graph();
        for (vertex, island) in graph.vertices().zip(graph.islands()) {
            let about = PyDict::new(py);
            about.set_item("position", graph.position(vertex).to_array())?;
            about.set_item("island", *island)?;
            directed.call_method("add_node", (vertex.0,), Some(&about))?;
        }
        for edge in graph.edges() {
            let about = PyDict::new(py);
            let evidence = &edge.evidence;
            about.set_item("ability", graph.name_of(evidence.ability))?;
            about.set_item("chance", evidence.chance().get())?;
            about.set_item("death_chance", evidence.death_chance())?;
            about.set_item("seconds", evidence.decisions_mean().0 * f64::from(DECISION_SECONDS))?;
            about.set_item("cost", evidence.cost())?;
            directed.call_method("add_edge", (edge.key.from.0, edge.key.to.0), Some(&about))?;
        }
        Ok(directed)
    }

    fn reach<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let frame = self.frame.unwrap_or_default();
        let described = py.detach(|| reachability::describe(self.graph()).in_level(&frame));
        let text = serde_json::to_string(&described).map_err(value)?;
        py.import("json")?.call_method1("loads", (text,))
    }

    fn reachable_from<'py>(&self, py: Python<'py>, vertex: u32) -> PyResult<Bound<'py, PyArray1<bool>>> {
        let vertex = VertexId(vertex);
        if !self.graph().has_vertex(vertex) {
            return Err(value(format!("there is no vertex {}: 0 to {}", vertex.0, self.graph().vertex_count() - 1)));
        }
        Ok(PyArray1::from_vec(py, self.graph().reachable_from(vertex)))
    }

    #[pyo3(signature = (*, pixels_per_m = 3.0, view = "top"))]
    fn png<'py>(&self, py: Python<'py>, pixels_per_m: f32, view: &str) -> PyResult<Bound<'py, PyBytes>> {
        let map = self.map.as_ref().ok_or_else(|| value("the graph has no level: pass one to Graph.load"))?;
        let view = picture::view(view)?;
        let bytes = py.detach(|| picture::draw(map, view, pixels_per_m, Some(self.graph())))?;
        Ok(PyBytes::new(py, &bytes))
    }

    fn _repr_png_<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyBytes>>> {
        let Some(map) = &self.map else { return Ok(None) };
        let bytes = py.detach(|| picture::draw(map, View::Top, picture::scale(map), Some(self.graph())))?;
        Ok(Some(PyBytes::new(py, &bytes)))
    }

    fn __repr__(&self) -> String {
        let graph = self.graph();
        format!(
            "<Graph {} vertices, {} edges, {} islands>",
            graph.vertex_count(),
            graph.edge_count(),
            graph.island_count()
        )
    }
}
