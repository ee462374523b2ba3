//! Levels as Surefoot reads them.

use crate::error::{SurefootError, chain};
use bevy_math::Vec3;
use std::error::Error;
use std::path::Path;
use std::sync::Arc;
use surefoot_levels::{ImportOptions, NoFiles};
use surefoot_world::Map;
use surefoot_world::mesh::Surface;

/// A level's file, for apps that want its geometry as colliders, or a graph aligned to it.
#[derive(Debug)]
pub struct SurefootLevel {
    map: Arc<Map>,
    origin: Vec3,
}

/// The format of a level's file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LevelFormat {
    /// `.glb`, or `.gltf` with embedded buffers.
    Gltf,
    /// `.obj`.
    Obj,
    /// `.sfmap`.
    Map,
}

/// All triangles of a level that have the same surface.
#[derive(Debug, Clone)]
pub struct SurfaceMesh {
    /// What they are made of.
    pub surface: Surface,
    /// Whether bodies collide with them; water and lava are areas.
    pub is_solid: bool,
    /// Corners in the coordinates of the scene, m.
    pub corners: Vec<Vec3>,
    /// Triangles.
    pub indices: Vec<[u32; 3]>,
}

impl SurefootLevel {
    /// Decodes a level.
    ///
    /// # Errors
    /// Says what is wrong with the file.
    pub fn from_bytes(bytes: &[u8], format: LevelFormat) -> Result<Self, SurefootError> {
        let rejected = |error: &dyn Error| SurefootError::Level(chain(error));
        let options = ImportOptions::default();
        let imported = match format {
            LevelFormat::Map => {
                let map = surefoot_levels::decode(bytes).map_err(|error| rejected(&error))?;
                let origin = map.frame().origin.as_vec3();
                return Ok(Self { map: Arc::new(map), origin });
            }
            LevelFormat::Gltf => surefoot_levels::import_gltf(bytes, None, &options, &NoFiles),
            LevelFormat::Obj => surefoot_levels::import_obj(bytes, None, &options),
        };
        let imported = imported.map_err(|error| rejected(&error))?;
        let origin = imported.map.frame().origin.as_vec3();
        Ok(Self { map: Arc::new(imported.map), origin })
    }

    /// Reads a level's file, whose format its name tells.
    ///
    /// # Errors
    /// If it cannot be read, or is no level.
    pub fn load(path: impl AsRef<Path>) -> Result<Self, SurefootError> {
        let path = path.as_ref();
        let format = match path.extension().and_then(|extension| extension.to_str()) {
            Some("glb" | "gltf") => LevelFormat::Gltf,
            Some("obj") => LevelFormat::Obj,
            Some("sfmap") => LevelFormat::Map,
            _ => {
                let message = format!("{} is neither a .glb, .gltf, .obj nor .sfmap", path.display());
                return Err(SurefootError::Level(message));
            }
        };
        let bytes = std::fs::read(path).map_err(|source| SurefootError::Io { path: path.to_owned(), source })?;
        Self::from_bytes(&bytes, format)
    }

    /// Where the level's own origin lies on its map, m. Graphs have the coordinates of the map.
    pub fn origin(&self) -> Vec3 {
        self.origin
    }

    /// The level as a map, in the coordinates of graphs.
    pub fn map(&self) -> &Arc<Map> {
        &self.map
    }

    /// The geometry, a mesh for each surface.
    pub fn meshes(&self) -> Vec<SurfaceMesh> {
        let mesh_of = |surface: Surface| {
            let triangles = self.map.mesh().triangles().iter().filter(|triangle| triangle.surface() == surface);
            let corners: Vec<Vec3> =
                triangles.flat_map(|triangle| triangle.corners()).map(|corner| corner - self.origin).collect();
            let indices = (0..corners.len() as u32 / 3).map(|idx| [3 * idx, 3 * idx + 1, 3 * idx + 2]).collect();
            SurfaceMesh { surface, is_solid: surface.is_solid(), corners, indices }
        };
        Surface::ALL.iter().copied().map(mesh_of).filter(|mesh| !mesh.corners.is_empty()).collect()
    }
}
