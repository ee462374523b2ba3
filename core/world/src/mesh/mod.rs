//! Triangles, indexed twice: a uniform grid for contacts and single rays, and upright columns for the cones of rays
//! that NPCs cast.
//!
//! Each cell of the grid lists the triangles that touch it; an empty cell holds a lower bound of the Chebyshev
//! distance, in cells, to the nearest cell with triangles, so that rays skip empty space. `columns` holds the other
//! index and `fan` casts through it, with the vectors of `lanes`; `docs/adr/0021-columns.md` explains why. `layers`
//! combines both with the triangles that edits add. parry3d's triangle is the reference: property tests compare rays
//! and contacts with it.

mod added;
mod climbed;
mod columns;
mod cones;
mod fan;
mod grid;
mod lanes;
mod layers;
mod ray;
mod triangle;

pub use climbed::{ClimbSpot, WallFace};
pub use cones::Cones;
pub use fan::{ConeHit, ConeHits, Elevations};
pub use lanes::LANES;
pub(crate) use lanes::bits;
pub use layers::{Mesh, Triangles};
pub use ray::RayHit;
pub use triangle::{Contact, Surface, Triangle};
