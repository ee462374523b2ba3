//! Plans as Python sees them.

use crate::arrays::rows;
use pyo3::prelude::*;
use surefoot_planner::search::many;
use surefoot_planner::{NavGraph, NoPath, Plan as Inner, Stop};
use surefoot_world::Vec3;
use surefoot_world::map::LevelFrame;

/// One leg of a plan.
#[pyclass(frozen, get_all, module = "surefoot")]
#[derive(Debug, Clone)]
pub struct Leg {
    /// Vertex where the leg begins; `None` for the start.
    from_vertex: Option<u32>,
    /// Vertex where the leg ends; `None` for the goal.
    to_vertex: Option<u32>,
    /// The most demanding ability that the leg needs.
    ability: String,
    seconds: f64,
    chance: f64,
    death_chance: f64,
}

#[pymethods]
impl Leg {
    fn __repr__(&self) -> String {
        let end = |vertex: Option<u32>, end: &str| vertex.map_or(end.to_owned(), |vertex| vertex.to_string());
        let (from, to) = (end(self.from_vertex, "start"), end(self.to_vertex, "goal"));
        format!("<Leg {from} to {to}, {}, {:.1} s, chance {:.2}>", self.ability, self.seconds, self.chance)
    }
}

/// The answer to a query.
#[pyclass(frozen, module = "surefoot")]
#[derive(Debug)]
pub struct Plan {
    waypoints: Vec<Vec3>,
    /// The level in whose coordinates the query was asked; `None`: in those of the map.
    frame: Option<LevelFrame>,
    #[pyo3(get)]
    legs: Vec<Leg>,
    #[pyo3(get)]
    seconds: f64,
    #[pyo3(get)]
    chance: f64,
    #[pyo3(get)]
    death_chance: f64,
    /// Why there is no path.
    #[pyo3(get)]
    no_path: Option<&'static str>,
}

impl Plan {
    /// A plan for a query in the coordinates of a level with this frame, or in those of the map.
    pub fn of(plan: &Inner, graph: &NavGraph, frame: Option<LevelFrame>) -> Self {
        let vertex = |stop: Stop| match stop {
            Stop::Vertex(vertex) => Some(vertex.0),
            Stop::Start | Stop::Goal => None,
        };
        let leg = |leg: &surefoot_planner::Leg| Leg {
            from_vertex: vertex(leg.key.from),
            to_vertex: vertex(leg.key.to),
            ability: graph.name_of(leg.ability).to_owned(),
            seconds: leg.seconds.0.into(),
            chance: leg.chance.get(),
            death_chance: leg.death_chance.into(),
        };
        let arrives = plan.no_path.is_none();
        Self {
            waypoints: plan.waypoints.clone(),
            frame,
            legs: plan.legs.iter().map(leg).collect(),
            seconds: plan.seconds().0.into(),
            chance: if arrives { plan.arrival_chance().get() } else { 0.0 },
            death_chance: plan.death_chance(),
            no_path: plan.no_path.map(name_of),
        }
    }
}

fn name_of(reason: NoPath) -> &'static str {
    match reason {
        NoPath::StartOffGraph => "start_off_graph",
        NoPath::GoalOffGraph => "goal_off_graph",
        NoPath::DifferentIslands => "different_islands",
        NoPath::OneWay => "one_way",
        NoPath::GoalInZone => "goal_in_zone",
    }
}

/// A place of many, and what the plan to it or from it promises.
#[pyclass(frozen, get_all, module = "surefoot")]
#[derive(Debug, Clone)]
pub struct Arrival {
    index: usize,
    /// Infinite without a path, as the cost.
    seconds: f64,
    cost: f64,
    chance: f64,
    death_chance: f64,
    /// Why there is no path.
    no_path: Option<&'static str>,
}

impl Arrival {
    pub fn of(index: usize, arrival: &Result<many::Arrival, NoPath>) -> Self {
        match arrival {
            Ok(arrival) => Self {
                index,
                seconds: arrival.seconds.0.into(),
                cost: arrival.cost.0.into(),
                chance: arrival.arrival_chance.get(),
                death_chance: arrival.death_chance,
                no_path: None,
            },
            Err(reason) => Self {
                index,
                seconds: f64::INFINITY,
                cost: f64::INFINITY,
                chance: 0.0,
                death_chance: 0.0,
                no_path: Some(name_of(*reason)),
            },
        }
    }
}

#[pymethods]
impl Arrival {
    fn __bool__(&self) -> bool {
        self.no_path.is_none()
    }

    fn __repr__(&self) -> String {
        match self.no_path {
            None => format!("<Arrival {}, {:.1} s, chance {:.2}>", self.index, self.seconds, self.chance),
            Some(reason) => format!("<Arrival {}, none, {reason}>", self.index),
        }
    }
}

#[pymethods]
impl Plan {
    #[getter]
    fn found(&self) -> bool {
        self.no_path.is_none()
    }

    /// Waypoints in order: of the map as 32-bit numbers, of a level as 64-bit numbers.
    #[getter]
    fn waypoints<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let waypoints = self.waypoints.iter();
        Ok(match &self.frame {
            None => rows(py, waypoints.map(Vec3::to_array))?.into_any(),
            Some(frame) => rows(py, waypoints.map(|&waypoint| frame.to_level(waypoint).to_array()))?.into_any(),
        })
    }

    fn __bool__(&self) -> bool {
        self.found()
    }

    fn __repr__(&self) -> String {
        match self.no_path {
            None => format!("<Plan {} legs, {:.1} s, chance {:.2}>", self.legs.len(), self.seconds, self.chance),
            Some(reason) => format!("<Plan none, {reason}>"),
        }
    }
}
