//! Triangles in a uniform grid: the one structure behind both contacts and rays.
//!
//! Each cell lists the triangles whose bounds touch it; a cell without any holds how many cells (Chebyshev
//! distance) it is certainly away from the nearest one with triangles, so that rays leap over empty space.
//! parry3d's triangle is the reference: property tests compare rays and contacts with it.

mod grid;
mod ray;
mod triangle;

pub use grid::Mesh;
pub use ray::RayHit;
pub use triangle::{Contact, Surface, Triangle};
