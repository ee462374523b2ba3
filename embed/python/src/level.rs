//! Levels: generated maps, and levels from files.

use crate::arrays::rows;
use crate::error::{chain, file, value};
use crate::picture;
use crate::threads::with_own_threads;
use numpy::{IntoPyArray, PyArray3, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use surefoot_levels::{ImportOptions, Imported, NoFiles, NodeReport};
use surefoot_net::levels::folder::LevelFolder;
use surefoot_report::render::View;
use surefoot_world::map::{DeviceKind, Features, MapKind, MapSize, MoverDensities, UpAxis};
use surefoot_world::{DVec3, Map, MapSpec, RawMapSpec};

/// A level; it never changes.
#[pyclass(frozen, module = "surefoot")]
#[derive(Debug)]
pub struct Level {
    pub map: Arc<Map>,
    warnings: Vec<String>,
    nodes: Vec<NodeReport>,
}

impl Level {
    fn of(Imported { map, warnings, nodes, .. }: Imported) -> Self {
        Self { map: Arc::new(map), warnings: warnings.iter().map(ToString::to_string).collect(), nodes }
    }
}

impl From<Arc<Map>> for Level {
    fn from(map: Arc<Map>) -> Self {
        Self { map, warnings: Vec::new(), nodes: Vec::new() }
    }
}

/// Loads a level from a file, with its sidecar if there is one.
fn load(path: &Path, options: &ImportOptions) -> PyResult<Level> {
    let bytes = std::fs::read(path).map_err(|error| file(path, &error))?;
    let beside = path.with_extension("surefoot.json");
    let sidecar = if beside.exists() {
        Some(std::fs::read_to_string(&beside).map_err(|error| file(&beside, &error))?)
    } else {
        None
    };
    let level = surefoot_levels::read_level(&bytes, sidecar.as_deref(), options, &LevelFolder::of(path));
    level.map(Level::of).map_err(|error| value(format!("{}: {}", path.display(), chain(&error))))
}

/// Extent of a map, m.
#[derive(FromPyObject)]
enum Extent {
    /// Width and depth.
    Side(u32),
    /// Width, height and depth.
    Sides(u32, u32, u32),
}

/// Densities of features or movers.
#[derive(FromPyObject)]
enum Densities {
    Text(String),
    Changes(BTreeMap<String, f32>),
}

impl Densities {
    /// The densities as a comma-separated text; `default` if there are no changes.
    fn text(self, default: &str) -> String {
        match self {
            Self::Text(text) => text,
            Self::Changes(changes) => {
                let each: Vec<String> = changes.iter().map(|(name, density)| format!("{name}={density}")).collect();
                if each.is_empty() { default.to_owned() } else { each.join(",") }
            }
        }
    }
}

/// One place, or several.
#[derive(FromPyObject)]
enum Places {
    One([f64; 3]),
    Many(Vec<[f64; 3]>),
}

impl Places {
    /// The places in other coordinates, as a tuple or as an array with a row for each.
    fn changed<'py>(self, py: Python<'py>, change: impl Fn(DVec3) -> DVec3) -> PyResult<Bound<'py, PyAny>> {
        let change = |place: [f64; 3]| change(DVec3::from_array(place)).to_array();
        match self {
            Self::One(place) => Ok(<(f64, f64, f64)>::from(change(place)).into_pyobject(py)?.into_any()),
            Self::Many(places) => Ok(rows(py, places.into_iter().map(change))?.into_any()),
        }
    }
}

#[pymethods]
impl Level {
    #[staticmethod]
    #[pyo3(signature = (seed, *, size = Extent::Side(250), kind = "terrain",
        features = Densities::Text("paper".to_owned()), movers = Densities::Text("none".to_owned()), repair = true))]
    fn generate(
        py: Python<'_>,
        seed: u64,
        size: Extent,
        kind: &str,
        features: Densities,
        movers: Densities,
        repair: bool,
    ) -> PyResult<Self> {
        let raw = RawMapSpec {
            seed,
            size: match size {
                Extent::Side(side) => MapSize { width: side, height: 80, depth: side },
                Extent::Sides(width, height, depth) => MapSize { width, height, depth },
            },
            features: features.text("paper").parse::<Features>().map_err(value)?,
            kind: kind.parse::<MapKind>().map_err(value)?,
            movers: movers.text("none").parse::<MoverDensities>().map_err(value)?,
            repair,
        };
        let spec = MapSpec::try_from(raw).map_err(value)?;
        let map = py.detach(|| with_own_threads(|| surefoot_generate::generate(&spec)));
        Ok(Self::of(Imported::saved(map)))
    }

    #[staticmethod]
    #[pyo3(signature = (path, *, scale = 1.0, up = "y", keep_sides = false, names = true, all_scenes = false))]
    fn load(
        py: Python<'_>,
        path: PathBuf,
        scale: f64,
        up: &str,
        keep_sides: bool,
        names: bool,
        all_scenes: bool,
    ) -> PyResult<Self> {
        let up = match up {
            "y" => UpAxis::Y,
            "z" => UpAxis::Z,
            other => return Err(value(format!("up is `{other}`, but must be \"y\" or \"z\""))),
        };
        let options = ImportOptions { scale, up, keep_sides, ignore_names: !names, all_scenes };
        py.detach(|| with_own_threads(|| load(&path, &options)))
    }

    #[staticmethod]
    fn from_bytes(py: Python<'_>, data: &[u8]) -> PyResult<Self> {
        let read = || surefoot_levels::read_level(data, None, &ImportOptions::default(), &NoFiles);
        let level = py.detach(|| with_own_threads(read));
        level.map(Self::of).map_err(|error| value(chain(&error)))
    }

    fn to_bytes<'py>(&self, py: Python<'py>) -> Bound<'py, PyBytes> {
        PyBytes::new(py, &py.detach(|| surefoot_levels::encode(&self.map)))
    }

    fn save(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        py.detach(|| std::fs::write(&path, surefoot_levels::encode(&self.map))).map_err(|error| file(&path, &error))
    }

    #[getter]
    fn hash(&self) -> String {
        self.map.hash().to_hex()
    }

    #[getter]
    fn size(&self) -> (u32, u32, u32) {
        let MapSize { width, height, depth } = self.map.size();
        (width, height, depth)
    }

    #[getter]
    fn origin(&self) -> (f64, f64, f64) {
        self.map.frame().origin.into()
    }

    #[getter]
    fn scale(&self) -> f64 {
        self.map.frame().scale
    }

    #[getter]
    fn up(&self) -> &'static str {
        match self.map.frame().up {
            UpAxis::Y => "y",
            UpAxis::Z => "z",
        }
    }

    fn to_map<'py>(&self, py: Python<'py>, place: Places) -> PyResult<Bound<'py, PyAny>> {
        place.changed(py, |place| self.map.frame().to_map(place).as_dvec3())
    }

    fn to_level<'py>(&self, py: Python<'py>, place: Places) -> PyResult<Bound<'py, PyAny>> {
        place.changed(py, |place| self.map.frame().to_level(place.as_vec3()))
    }

    #[getter]
    fn seed(&self) -> Option<u64> {
        self.map.spec().map(|spec| spec.seed)
    }

    #[getter]
    fn kind(&self) -> Option<&'static str> {
        self.map.spec().map(|spec| spec.kind.name())
    }

    #[getter]
    fn warnings(&self) -> Vec<String> {
        self.warnings.clone()
    }

    #[getter]
    fn nodes<'py>(&self, py: Python<'py>) -> PyResult<Vec<Bound<'py, PyDict>>> {
        let dict = |node: &NodeReport| {
            let dict = PyDict::new(py);
            dict.set_item("index", node.index)?;
            dict.set_item("name", &node.name)?;
            dict.set_item("role", node.role.to_string())?;
            dict.set_item("reason", &node.reason)?;
            dict.set_item("triangles", node.triangles)?;
            dict.set_item("bounds", node.bounds.map(|bounds| bounds.map(<(f64, f64, f64)>::from)))?;
            Ok(dict)
        };
        self.nodes.iter().map(dict).collect()
    }

    #[getter]
    fn features<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let placed = self.map.placed();
        let counts = PyDict::new(py);
        for kind in DeviceKind::ALL {
            counts.set_item(kind.plural(), placed.devices_of(*kind).count())?;
        }
        counts.set_item("movers", self.map.movers().len())?;
        Ok(counts)
    }

    #[pyo3(signature = (*, pixels_per_m = 3.0, view = "top"))]
    fn png<'py>(&self, py: Python<'py>, pixels_per_m: f32, view: &str) -> PyResult<Bound<'py, PyBytes>> {
        let view = picture::view(view)?;
        let picture = py.detach(|| picture::draw(&self.map, view, pixels_per_m, None))?;
        Ok(PyBytes::new(py, &picture))
    }

    #[pyo3(signature = (*, pixels_per_m = 3.0, view = "top"))]
    fn pixels<'py>(&self, py: Python<'py>, pixels_per_m: f32, view: &str) -> PyResult<Bound<'py, PyArray3<u8>>> {
        let view = picture::view(view)?;
        let (shape, rgb) =
            py.detach(|| picture::draw(&self.map, view, pixels_per_m, None).map(|png| picture::pixels(&png)))?;
        rgb.into_pyarray(py).reshape(shape)
    }

    fn _repr_png_<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
        let picture = py.detach(|| picture::draw(&self.map, View::Top, picture::scale(&self.map), None))?;
        Ok(PyBytes::new(py, &picture))
    }

    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<(Bound<'py, PyAny>, (Bound<'py, PyBytes>,))> {
        let restore = slf.get_type().getattr("from_bytes")?;
        Ok((restore, (slf.get().to_bytes(slf.py()),)))
    }

    fn __copy__(slf: Py<Self>) -> Py<Self> {
        slf
    }

    fn __deepcopy__(slf: Py<Self>, _memo: &Bound<'_, PyAny>) -> Py<Self> {
        slf
    }

    fn __eq__(&self, other: &Bound<'_, PyAny>) -> bool {
        other.cast::<Self>().is_ok_and(|other| other.get().map.hash() == self.map.hash())
    }

    fn __hash__(&self) -> u64 {
        let hash = self.map.hash().to_hex();
        u64::from_str_radix(&hash[..15], 16).unwrap_or_default()
    }

    fn __repr__(&self) -> String {
        let MapSize { width, height, depth } = self.map.size();
        let source = match self.map.spec() {
            Some(spec) => format!("seed {}, {}", spec.seed, spec.kind.name()),
            None => "imported".to_owned(),
        };
        format!("<Level {source}, {width} x {height} x {depth} m, {}>", &self.map.hash().to_hex()[..12])
    }
}
