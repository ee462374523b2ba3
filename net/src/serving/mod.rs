//! The server's side of every Surefoot endpoint: limits, TLS and tokens, health checking, reflection, Connect with JSON, and
//! a bounded drain.
//!
//! [`Endpoint`] combines the modules: `incoming` accepts connections (how many, how long silent), `generations` serves them with the
//! present certificate, `gate` checks requests (who, by [`access`], and by when: `deadline`), `metered` counts large ones, `revocation` ends calls whose token is removed, `connect` translates requests of the Connect protocol into gRPC.

pub mod access;
mod connect;
mod deadline;
mod endpoint;
mod files;
mod gate;
mod generations;
mod health;
mod incoming;
mod limits;
mod metered;
mod methods;
mod openapi;
mod origin;
mod protocol;
mod revocation;
pub mod security;
mod shutdown;
pub mod tokens;

pub use endpoint::{Endpoint, EndpointConfig, ServeError};
pub use files::FileError;
pub(crate) use files::{RELOAD_PERIOD, Stamp, read, read_identity, stamp};
pub use gate::Caller;
pub use limits::{Limits, MAX_MESSAGE_BYTES};
pub use security::Security;
pub use shutdown::{Shutdown, shutting_down};
