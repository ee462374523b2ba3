//! What changes a graph after its build: designers' edits, a changed map, and traversals that NPCs report.

mod editable;
pub mod edits;
pub mod live;
pub mod update;
