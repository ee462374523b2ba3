//! Zones of queries by their fields, and tags.

use crate::envs::place;
use crate::error::value;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use serde::Deserialize;
use surefoot_planner::zones::{MAX_ZONES, check_tags};
use surefoot_planner::{Aabb, Rule, Shape, Tags, Zone, Zones};
use surefoot_world::map::LevelFrame;
use surefoot_world::{DVec3, Vec3};

/// The fields of a zone: `box`, or `bottom`, `radius` and `height`; `price`, `only_with_tag`, or neither.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Fields {
    name: String,
    #[serde(rename = "box")]
    corners: Option<[[f64; 3]; 2]>,
    bottom: Option<[f64; 3]>,
    #[serde(default)]
    radius: f32,
    #[serde(default)]
    height: f32,
    price: Option<f32>,
    only_with_tag: Option<String>,
    #[serde(default)]
    for_tags: Vec<String>,
}

/// Reads zones whose places are in the coordinates of `frame`.
pub fn read(py: Python<'_>, zones: &[Bound<'_, PyDict>], frame: Option<LevelFrame>) -> PyResult<Zones> {
    if zones.len() > MAX_ZONES {
        return Err(value(format!("there are {} zones, but a query has at most {MAX_ZONES}", zones.len())));
    }
    let json = py.import("json")?;
    let zone = |fields: &Bound<'_, PyDict>| {
        let text: String = json.call_method1("dumps", (fields,))?.extract()?;
        let fields: Fields = serde_json::from_str(&text).map_err(|error| value(format!("zone: {error}")))?;
        let name = fields.name.clone();
        let zone = zone_of(fields, frame)?;
        zone.check().map_err(|error| value(format!("zone `{name}`: {error}")))
    };
    Ok(Zones::new(zones.iter().map(zone).collect::<PyResult<Vec<Zone>>>()?))
}

/// Reads tags.
pub fn read_tags(tags: Vec<String>) -> PyResult<Tags> {
    check_tags(tags).map_err(|error| value(format!("tags: {error}")))
}

fn zone_of(fields: Fields, frame: Option<LevelFrame>) -> PyResult<Zone> {
    let Fields { name, corners, bottom, radius, height, price, only_with_tag, for_tags } = fields;
    let on_map = |at: [f64; 3]| -> PyResult<Vec3> {
        let at = DVec3::from_array(at);
        place(&format!("zone `{name}`"), frame.map_or(at.as_vec3(), |frame| frame.to_map(at)).to_array())
    };
    let shape = match (corners, bottom) {
        (Some([one, other]), None) => {
            // An axis of a level with z up is opposite to the map's.
            let (one, other) = (on_map(one)?, on_map(other)?);
            Shape::Box(Aabb { low: one.min(other), high: one.max(other) })
        }
        (None, Some(bottom)) => Shape::Cylinder { bottom: on_map(bottom)?, radius, height },
        _ => return Err(value(format!("zone `{name}`: give either box, or bottom, radius and height"))),
    };
    let rule = match (price, only_with_tag) {
        (Some(price), None) => Rule::Price(price),
        (None, Some(tag)) => Rule::OnlyWith(tag),
        (None, None) => Rule::Never,
        _ => return Err(value(format!("zone `{name}`: price and only_with_tag exclude each other"))),
    };
    Ok(Zone { name, shape, rule, concerns: for_tags.into_iter().collect() })
}
