//! What people look at: pictures of maps with graphs and tracks drawn over them, and plots of results.
//!
//! [`render`] draws maps into PNG files, [`plots`] numbers into SVG files. Nothing is measured or simulated here.

pub mod plots;
pub mod render;

use std::path::PathBuf;

/// A picture or plot that cannot be written.
#[derive(Debug, thiserror::Error)]
pub enum ReportError {
    /// The file cannot be created or written.
    #[error("cannot write {0}: {1}")]
    Write(PathBuf, std::io::Error),
    /// The picture cannot be encoded or drawn.
    #[error("cannot draw {0}: {1}")]
    Draw(PathBuf, String),
}
