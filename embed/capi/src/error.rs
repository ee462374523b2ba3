//! Errors: a status, and a text with what to change.

use crate::abi;
use std::ffi::c_char;

/// Status that functions return, as in the header.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(i32)]
pub enum Status {
    /// Success.
    Ok = 0,
    /// An argument is null, not finite, or out of its range.
    InvalidArgument = 1,
    /// An output has too little room; the needed size was written.
    BufferTooSmall = 2,
    /// A file, a vertex, an edge or an NPC does not exist.
    NotFound = 3,
    /// A file is damaged, or of another kind or version.
    BadFile = 4,
    /// Another call with the same handle is running.
    Busy = 5,
    /// Another call has to come first.
    BadState = 6,
    /// A fault of the library.
    Internal = 7,
}

/// Why a call fails.
#[derive(Debug)]
pub struct Fault {
    /// Kind of the fault.
    pub status: Status,
    /// What is wrong and what to change.
    pub message: String,
}

impl Fault {
    /// A fault of that kind.
    pub fn new(status: Status, message: impl Into<String>) -> Self {
        Self { status, message: message.into() }
    }

    /// An argument that is wrong.
    pub fn argument(message: impl Into<String>) -> Self {
        Self::new(Status::InvalidArgument, message)
    }

    /// A file that is wrong.
    pub fn file(message: impl Into<String>) -> Self {
        Self::new(Status::BadFile, message)
    }

    /// The fault for callers; a text that is too long is cut off between two characters.
    pub fn to_abi(&self) -> abi::Error {
        let mut message = [0; abi::MESSAGE_LEN];
        let mut end = self.message.len().min(abi::MESSAGE_LEN - 1);
        while !self.message.is_char_boundary(end) {
            end -= 1;
        }
        for (to, from) in message.iter_mut().zip(&self.message.as_bytes()[..end]) {
            *to = *from as c_char;
        }
        abi::Error { code: self.status as i32, message }
    }
}

/// The text of an error and its causes.
pub fn chain(error: &dyn std::error::Error) -> String {
    let mut text = error.to_string();
    let mut cause = error.source();
    while let Some(error) = cause {
        text = format!("{text}: {error}");
        cause = error.source();
    }
    text
}
