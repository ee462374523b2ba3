//! What can be wrong with files and blocks.

use std::error::Error;
use std::path::PathBuf;
use surefoot_world::map::PieceError;

/// A file or a block cannot be used; the message says what to change.
#[derive(Debug, thiserror::Error)]
pub enum SurefootError {
    /// A file cannot be read.
    #[error("cannot read {}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// A manifest is none.
    #[error("the manifest is not a model's manifest.json: {0}")]
    Manifest(#[source] serde_json::Error),
    /// Weights are damaged, or do not fit their manifest or this version.
    #[error("the policy cannot be used: {0}")]
    Policy(String),
    /// No policy of that name is built in.
    #[error("no policy {0} is built in: use general-reactive or general-lstm")]
    NoPolicy(String),
    /// A graph is damaged, or no graph.
    #[error("the graph cannot be used: {0}")]
    Graph(String),
    /// A graph has no such edge.
    #[error("the graph has no edge from vertex {from} to vertex {to}")]
    NoEdge {
        /// Where it would begin.
        from: u32,
        /// Where it would end.
        to: u32,
    },
    /// A level cannot be imported.
    #[error("the level cannot be used: {0}")]
    Level(String),
    /// A block cannot be put into the level.
    #[error("the blocks cannot be used: {0}")]
    Blocks(#[from] PieceError),
    /// Blocks are of no use without rehearsals.
    #[error("the graph has no rehearsals, which blocks are for: call SurefootGraph::rehearsed_on first")]
    NoRehearsals,
    /// A graph belongs to another level.
    #[error(
        "{astray} of the graph's {count} vertices are nowhere to stand in this level: \
         export the graph from this very file, with the body that walks there"
    )]
    OtherLevel {
        /// Vertices where the character cannot stand.
        astray: usize,
        /// All vertices.
        count: usize,
    },
}

/// An error with its causes, in one line.
pub(crate) fn chain(error: &dyn Error) -> String {
    let causes = std::iter::successors(error.source(), |cause: &&dyn Error| (*cause).source());
    causes.fold(error.to_string(), |text, cause| {
        let cause = cause.to_string();
        if text.ends_with(&cause) { text } else { format!("{text}: {cause}") }
    })
}
