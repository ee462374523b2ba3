//! Reads Wavefront OBJ into a scene: objects and groups become nodes.
//!
//! Only positions, faces, lines and names reach the parser: texture coordinates and normals are not needed, and without
//! them there are fewer indices to trust.

use crate::faults::{ImportError, MAX_TRIANGLES};
use crate::scene::{Node, Scene};
use surefoot_world::Vec3;
use tobj::{LoadError, LoadOptions};

/// Name that the parser gives to objects without one.
const UNNAMED: &str = "unnamed_object";

pub(super) fn read(bytes: &[u8]) -> Result<Scene, ImportError> {
    let text = geometry_lines(&String::from_utf8_lossy(bytes));
    // Lines and points become triangles without area: they count towards the bounds of features.
    let options = LoadOptions { triangulate: true, ..LoadOptions::default() };
    let no_materials = |_: &std::path::Path| Ok((Vec::new(), Default::default()));
    let (models, _) = tobj::load_obj_buf(&mut text.as_bytes(), &options, no_materials).map_err(describe)?;
    if models.iter().map(|model| model.mesh.indices.len() / 3).sum::<usize>() > MAX_TRIANGLES {
        return Err(ImportError::TooManyTriangles);
    }
    let nodes = models.into_iter().filter(|model| !model.mesh.indices.is_empty()).map(|model| {
        let (positions, _) = model.mesh.positions.as_chunks::<3>();
        let (corners, _) = model.mesh.indices.as_chunks::<3>();
        let triangles = corners.iter().map(|corners| corners.map(|idx| Vec3::from(positions[idx as usize]))).collect();
        let name = if model.name == UNNAMED { String::new() } else { model.name };
        Node { name, parent: None, origin: Vec3::ZERO, triangles, extras: None, animation: None }
    });
    Ok(Scene { nodes: nodes.collect(), former_size: None, skipped_count: 0 })
}

/// Keeps the lines that matter, with nothing but coordinates on those of vertices.
fn geometry_lines(text: &str) -> String {
    let joined = if text.contains('\\') { text.replace("\\\r\n", " ").replace("\\\n", " ") } else { text.to_owned() };
    let mut lines = String::with_capacity(joined.len());
    for line in joined.lines().map(str::trim) {
        let mut words = line.split_ascii_whitespace();
        match words.next() {
            Some("v") => {
                lines.push('v');
                for word in words.take(3) {
                    lines.push(' ');
                    lines.push_str(word);
                }
                lines.push('\n');
            }
            Some("f" | "l" | "o" | "g") => {
                lines.push_str(line);
                lines.push('\n');
            }
            _ => {}
        }
    }
    lines
}

fn describe(error: LoadError) -> ImportError {
    ImportError::Obj(match error {
        LoadError::PositionParseError => "a `v` line does not hold three numbers".to_owned(),
        LoadError::FaceParseError => "an `f` or `l` line does not hold vertex numbers".to_owned(),
        LoadError::InvalidPolygon => "an `f` line holds no vertices".to_owned(),
        LoadError::FaceVertexOutOfBounds => "a face refers to a vertex that does not exist".to_owned(),
        other => other.to_string(),
    })
}
