//! Errors as Python's exceptions: one line that says what to change.

use pyo3::PyErr;
use pyo3::exceptions::{PyOSError, PyRuntimeError, PyTypeError, PyValueError};
use std::path::Path;

/// An argument, or the content of a file, that is of no use.
pub fn value(message: impl std::fmt::Display) -> PyErr {
    PyValueError::new_err(message.to_string())
}

/// The text of an error and of all that caused it.
pub fn chain(error: &dyn std::error::Error) -> String {
    let mut text = error.to_string();
    let mut cause = error.source();
    while let Some(error) = cause {
        let why = error.to_string();
        // Some errors say what caused them.
        if !text.ends_with(&why) {
            text = format!("{text}: {why}");
        }
        cause = error.source();
    }
    text
}

/// A call that came at the wrong time.
pub fn state(message: impl std::fmt::Display) -> PyErr {
    PyRuntimeError::new_err(message.to_string())
}

/// An object that cannot be copied or pickled.
pub fn fixed(message: &'static str) -> PyErr {
    PyTypeError::new_err(message)
}

/// A file that cannot be read or written: `FileNotFoundError` and its like.
pub fn file(path: &Path, error: &std::io::Error) -> PyErr {
    let name = path.display().to_string();
    match error.raw_os_error() {
        Some(code) => {
            let text = error.to_string();
            let text = text.split(" (os error").next().unwrap_or_default().to_owned();
            PyOSError::new_err((code, text, name))
        }
        None => PyOSError::new_err(format!("{name}: {error}")),
    }
}
