//! Pictures of maps, with graphs and tracks drawn over them, and plots of results.
//!
//! [`render`] draws maps as PNG files, [`plots`] draws numbers as SVG files. This crate neither measures nor simulates.

pub mod plots;
pub mod render;

use std::path::PathBuf;

/// Why a picture or plot cannot be written.
#[derive(Debug, thiserror::Error)]
pub enum ReportError {
    /// The file cannot be created or written.
    #[error("cannot write {0}: {1}")]
    Write(PathBuf, std::io::Error),
    /// The picture cannot be encoded or drawn.
    #[error("cannot draw {0}: {1}")]
    Draw(PathBuf, String),
}
