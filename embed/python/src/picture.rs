//! Pictures of levels and graphs, for notebooks and frames.

use crate::error::value;
use crate::threads::with_own_threads;
use pyo3::PyResult;
use std::io::Cursor;
use surefoot_planner::NavGraph;
use surefoot_report::render::{Picture, View};
use surefoot_world::Map;

/// Side of a picture in a notebook, in pixels.
const SIDE: f32 = 720.0;
/// Greatest number of pixels of a picture.
const MOST_PIXELS: f32 = 40.0e6;

/// The view with this name.
pub fn view(name: &str) -> PyResult<View> {
    match name {
        "top" => Ok(View::Top),
        "iso" => Ok(View::Iso),
        _ => Err(value(format!("there is no view {name}: top or iso"))),
    }
}

/// Pixels per metre of a picture for a notebook.
pub fn scale(map: &Map) -> f32 {
    SIDE / map.extent().x.max(map.extent().z)
}

/// Draws a level, and a graph of it, as the content of a PNG file.
pub fn draw(map: &Map, view: View, pixels_per_m: f32, graph: Option<&NavGraph>) -> PyResult<Vec<u8>> {
    let extent = map.extent();
    let pixels = 4.0 * extent.x.max(extent.z).powi(2) * pixels_per_m * pixels_per_m;
    if !(pixels_per_m >= 0.1 && pixels <= MOST_PIXELS) {
        return Err(value(format!(
            "pixels_per_m is {pixels_per_m}, but must be 0.1 to {:.1} for this level",
            (MOST_PIXELS / 4.0).sqrt() / extent.x.max(extent.z)
        )));
    }
    let mut picture = with_own_threads(|| Picture::of(map, view, pixels_per_m, None));
    if let Some(graph) = graph {
        let at = |vertex| graph.position(vertex);
        let edges = graph.edges().map(|edge| (at(edge.key.from), at(edge.key.to), edge.evidence.ability));
        picture.graph(graph.vertices().map(at), edges);
    }
    Ok(picture.to_png())
}

/// Height, width and RGB values of a PNG file that [`draw`] made.
pub fn pixels(png: &[u8]) -> ([usize; 3], Vec<u8>) {
    let mut reader = png::Decoder::new(Cursor::new(png)).read_info().expect("a PNG of ours");
    let (width, height) = reader.info().size();
    let mut rgb = vec![0; width as usize * height as usize * 3];
    reader.next_frame(&mut rgb).expect("a PNG of ours");
    ([height as usize, width as usize, 3], rgb)
}
