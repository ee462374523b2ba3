//! The server's side of every Surefoot endpoint: limits, TLS, tokens, health checks, reflection, Connect, and a bounded
//! drain.
//!
//! [`Endpoint`] combines the modules. `incoming` accepts connections and closes silent ones, `generations` serves them
//! with the current certificate, `gate` checks requests ([`access`] has the roles, `deadline` the deadlines). `metered`
//! counts large requests, `revocation` ends calls whose token is removed, `connect` translates calls of the Connect
//! protocol into gRPC, `health` reports the state of the services.

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
