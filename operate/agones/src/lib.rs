//! A world server as a game server of Agones (<https://agones.dev>): reports to the sidecar of the SDK when its worlds
//! are restored, that they tick, how many worlds and NPCs it has, and that it has ended.
//!
//! [`run_with_sidecar`] does all of it beside a running server; start reading in `companion.rs`. [`sidecar`] is the
//! client of the sidecar. This crate only observes the server, through its
//! [`Observer`](surefoot_server::observer::Observer): an unreachable sidecar never keeps worlds from being served.

mod companion;
pub mod sidecar;

/// Generated code of the contracts of the sidecar. They are those of Agones (Apache-2.0, see `operate/agones/proto/`).
pub mod proto {
    /// The SDK.
    #[expect(missing_docs, reason = "generated code")]
    pub mod sdk {
        tonic::include_proto!("agones.dev.sdk");
    }
    /// Its counters.
    #[expect(missing_docs, reason = "generated code")]
    pub mod beta {
        tonic::include_proto!("agones.dev.sdk.beta");
    }
}

pub use companion::{Pace, run_with_sidecar};
