//! How a level's own coordinates relate to its map's.

use crate::Vec3;
use glam::DVec3;
use serde::{Deserialize, Serialize};

/// Vertical axis of a level.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub enum UpAxis {
    /// y is up, as in glTF and on maps.
    #[default]
    Y,
    /// z is up, as in many OBJ files: (x, y, z) becomes (x, z, -y).
    Z,
}

/// The transform from a level's own coordinates to its map's. It is no part of the map's content hash.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct LevelFrame {
    /// Position of the level's origin on the map, m.
    pub origin: DVec3,
    /// Metres per unit of the level, above 0.
    pub scale: f64,
    /// Vertical axis of the level.
    pub up: UpAxis,
}

impl Default for LevelFrame {
    /// The frame of a generated map: the map's own.
    fn default() -> Self {
        Self { origin: DVec3::ZERO, scale: 1.0, up: UpAxis::Y }
    }
}

impl LevelFrame {
    /// A point of the level, on the map.
    pub fn to_map(&self, point: DVec3) -> Vec3 {
        (self.to_metres(point) + self.origin).as_vec3()
    }

    /// A direction or velocity of the level, on the map.
    pub fn vector_to_map(&self, vector: DVec3) -> Vec3 {
        self.to_metres(vector).as_vec3()
    }

    /// A point of the map, in the level's own coordinates.
    pub fn to_level(&self, point: Vec3) -> DVec3 {
        self.level_units(point.as_dvec3() - self.origin)
    }

    /// A direction or velocity on the map, in the level's own coordinates.
    pub fn vector_to_level(&self, vector: Vec3) -> DVec3 {
        self.level_units(vector.as_dvec3())
    }

    /// A point or vector of the level in metres, y up, about the level's own origin.
    pub fn to_metres(&self, point: DVec3) -> DVec3 {
        let upright = match self.up {
            UpAxis::Y => point,
            UpAxis::Z => DVec3::new(point.x, point.z, -point.y),
        };
        upright * self.scale
    }

    /// Whether the level's coordinates are those of the map.
    pub fn is_map(&self) -> bool {
        *self == Self::default()
    }

    /// A place of the map in the level's own coordinates; `None` if they are those of the map.
    pub fn other_place(&self, place: Vec3) -> Option<DVec3> {
        (!self.is_map()).then(|| self.to_level(place))
    }

    /// A place of the map for people: on the map and, where they differ, in the level's own coordinates.
    pub fn describe(&self, place: Vec3) -> String {
        format!("({:.1}, {:.1}, {:.1}){}", place.x, place.y, place.z, self.aside(place))
    }

    /// What [`describe`](Self::describe) says besides the place on the map; empty where the coordinates do not differ.
    pub fn aside(&self, place: Vec3) -> String {
        self.other_place(place).map(|place| format!(", in the level {}", self.format(place))).unwrap_or_default()
    }

    /// The places of a map of this extent, m, for people: on the map and, where they differ, in the level's own
    /// coordinates.
    pub fn describe_span(&self, extent: Vec3) -> String {
        let on_map = format!("0 to {:?} m", extent.to_array());
        if self.is_map() {
            return on_map;
        }
        let (a, b) = (self.to_level(Vec3::ZERO), self.to_level(extent));
        format!("{on_map}, in the level {} to {}", self.format(a.min(b)), self.format(a.max(b)))
    }

    /// A place of the level, to about 0.1 m.
    fn format(&self, place: DVec3) -> String {
        let digits = if self.scale > 1.0 { 3 } else { 1 };
        format!("({:.digits$}, {:.digits$}, {:.digits$})", place.x, place.y, place.z)
    }

    fn level_units(&self, point: DVec3) -> DVec3 {
        let point = point / self.scale;
        match self.up {
            UpAxis::Y => point,
            UpAxis::Z => DVec3::new(point.x, -point.z, point.y),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_point_comes_back_from_the_map_whatever_the_frame() {
        let origin = DVec3::new(-512_345.25, 2.0, 5_400_123.5);
        for (scale, up) in [(1.0, UpAxis::Y), (0.01, UpAxis::Z), (2.5, UpAxis::Z)] {
            let frame = LevelFrame { origin, scale, up };
            let on_map = Vec3::new(10.25, 3.0, 77.5);
            assert!((frame.to_map(frame.to_level(on_map)) - on_map).length() < 1.0e-4, "{frame:?}");
            let vector = Vec3::new(1.0, -2.0, 3.0);
            assert!((frame.vector_to_map(frame.vector_to_level(vector)) - vector).length() < 1.0e-5, "{frame:?}");
        }
        let frame = LevelFrame { origin: DVec3::ZERO, scale: 0.01, up: UpAxis::Z };
        assert_eq!(frame.to_map(DVec3::new(100.0, 200.0, 300.0)), Vec3::new(1.0, 3.0, -2.0));
    }

    #[test]
    fn people_read_places_of_a_level_in_its_own_coordinates_too() {
        let place = Vec3::new(10.5, 3.0, 7.5);
        assert_eq!(LevelFrame::default().describe(place), "(10.5, 3.0, 7.5)");
        let frame = LevelFrame { origin: DVec3::new(2.0, 0.0, 27.5), scale: 0.01, up: UpAxis::Z };
        assert_eq!(frame.describe(place), "(10.5, 3.0, 7.5), in the level (850.0, 2000.0, 300.0)");
        let span = frame.describe_span(Vec3::new(50.0, 20.0, 30.0));
        assert_eq!(span, "0 to [50.0, 20.0, 30.0] m, in the level (-200.0, -250.0, 0.0) to (4800.0, 2750.0, 2000.0)");
    }
}
