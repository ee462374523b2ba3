//! Triangles in a uniform grid: one structure for both contacts and rays.
//!
//! Each cell lists the triangles that touch it; an empty cell holds a lower bound of the Chebyshev distance, in
//! cells, to the nearest cell with triangles, so that rays skip empty space.
//! parry3d's triangle is the reference: property tests compare rays and contacts with it.

mod columns;
mod fan;
mod grid;
mod lanes;
mod ray;
mod triangle;

pub use fan::{ConeHit, ConeHits, Elevations};
pub use grid::Mesh;
pub use lanes::LANES;
pub use ray::RayHit;
pub use triangle::{Contact, Surface, Triangle};
