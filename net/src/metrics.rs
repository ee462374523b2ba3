//! Metrics in Prometheus text format.

use std::fmt::{Display, Write};

/// Renders the metric `surefoot_{name}`: its type, and samples with their labels, in braces, and values.
pub fn family<L: Display>(name: &str, kind: &str, help: &str, samples: impl IntoIterator<Item = (L, f64)>) -> String {
    let mut text = format!("# HELP surefoot_{name} {help}\n# TYPE surefoot_{name} {kind}\n");
    for (labels, value) in samples {
        // Writing to a string cannot fail.
        let _ = writeln!(text, "surefoot_{name}{labels} {value}");
    }
    text
}
