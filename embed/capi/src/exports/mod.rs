//! The exported functions, one for each of the header: decode, call, encode.
//!
//! The header documents functions and arguments. Every function, except those that destroy, takes an error last, which
//! may be null, and returns a status.

mod agents;
mod followers;
mod graphs;
mod worlds;

pub use agents::*;
pub use followers::*;
pub use graphs::*;
pub use worlds::*;

use crate::abi;
use crate::error::Fault;
use crate::memory;
use std::ffi::c_char;
use std::path::Path;
use std::sync::Mutex;
use surefoot_world::{CharacterProfile, RawCharacterProfile};

/// State for one thread at a time: a second call at the same time returns `SF_BUSY`.
pub type Handle<T> = Mutex<T>;

/// Defines exported functions, adding the error argument and the status.
macro_rules! export {
    ($(fn $name:ident($($argument:ident: $kind:ty),* $(,)?) $body:block)*) => {
        $(
            #[doc = concat!("`", stringify!($name), "`: see the header.")]
            ///
            /// # Safety
            /// The arguments are as the header requires.
            #[unsafe(no_mangle)]
            pub unsafe extern "C" fn $name($($argument: $kind,)* error: *mut crate::abi::Error) -> i32 {
                // SAFETY: the header requires what the conversions of `memory` need.
                unsafe { crate::memory::guard(error, || $body) }
            }
        )*
    };
}

/// Defines exported functions that destroy handles; null is allowed.
macro_rules! destroy {
    ($($name:ident $kind:ty),*) => {
        $(
            #[doc = concat!("`", stringify!($name), "`: see the header.")]
            ///
            /// # Safety
            /// `handle` is null, or was made by this library and not destroyed, and no call with it is running.
            #[unsafe(no_mangle)]
            pub unsafe extern "C" fn $name(handle: *mut $kind) {
                // SAFETY: passed on.
                unsafe { crate::memory::destroy(handle) };
            }
        )*
    };
}

pub(crate) use {destroy, export};

/// `sf_version`: see the header.
#[unsafe(no_mangle)]
pub extern "C" fn sf_version() -> *const c_char {
    concat!(env!("CARGO_PKG_VERSION"), "\0").as_ptr().cast()
}

/// `sf_abi_version`: see the header.
#[unsafe(no_mangle)]
pub extern "C" fn sf_abi_version() -> u32 {
    abi::ABI_VERSION
}

export! {
    fn sf_body_default(body: *mut abi::Body) {
        memory::write(body, "body", abi::Body::of(&RawCharacterProfile::default()))
    }
}

/// The profile of a body; the default profile for null.
///
/// # Safety
/// As for [`memory::growing`].
unsafe fn profile(body: *const abi::Body) -> Result<CharacterProfile, Fault> {
    if body.is_null() {
        return Ok(CharacterProfile::default());
    }
    // SAFETY: passed on.
    unsafe { memory::growing(body, "body") }?.profile()
}

/// Reads a file.
///
/// # Safety
/// As for [`memory::text`].
unsafe fn read(path: *const c_char) -> Result<Vec<u8>, Fault> {
    // SAFETY: passed on.
    let path = unsafe { memory::text(path, "path") }?;
    std::fs::read(Path::new(path)).map_err(|error| {
        let message = format!("path is {path}, which cannot be read: {error}");
        Fault::new(crate::error::Status::NotFound, message)
    })
}
