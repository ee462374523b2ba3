//! The server's side of every Surefoot endpoint: limits, TLS and tokens, health checking, reflection, gRPC-Web, Connect with JSON,
//! and a bounded drain.
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

/// Adds gRPC-Web to a service, for browsers.
pub fn with_grpc_web<S>(service: S) -> tonic::service::Layered<tonic_web::GrpcWebService<S>, S>
where
    S: tonic::server::NamedService,
    tonic_web::GrpcWebService<S>: Clone,
{
    use tonic::service::LayerExt;
    tonic_web::GrpcWebLayer::new().named_layer(service)
}
