//! A world server as a game server of Agones (<https://agones.dev>): tells the SDK's sidecar when its worlds stand, that its simulation goes on, how
//! many worlds and NPCs it has, and that it has ended.
//!
//! [`run_with_sidecar`] does all of it beside a server that runs; start reading in `companion.rs`. [`sidecar`] is the client of the sidecar. This crate only
//! looks at the server, through its [`Observer`](surefoot_server::observer::Observer): a sidecar that is away or refuses never keeps worlds from being served.

mod companion;
pub mod sidecar;

/// Generated code of the sidecar's contracts. They are those of Agones (Apache-2.0, see `operate/agones/proto/`).
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
