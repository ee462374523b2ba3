//! Which web pages may call. A browser tells where a page comes from; every other client says nothing and is not asked.

use crate::status;
use axum::http::request::Parts;
use axum::http::{HeaderMap, HeaderName, HeaderValue, Method, Uri, header};
use std::net::IpAddr;
use std::sync::Arc;
use std::time::Duration;
use surefoot_proto::reason::Reason;
use tonic::Status;
use tower_http::cors::{AllowHeaders, AllowOrigin, CorsLayer};

/// How long a browser may remember that it may call.
const REMEMBERED: Duration = Duration::from_secs(600);
/// What a page may read of an answer of gRPC-Web.
const SHOWN: [&str; 3] = ["grpc-status", "grpc-message", "grpc-status-details-bin"];

/// The pages that may call.
#[derive(Debug, Clone, Default)]
pub(super) struct Origins {
    /// Those that were named, such as `https://studio.example`.
    pub named: Arc<[String]>,
    /// Only who has a token or trusts the certificate gets an answer: pages of any name may be served here.
    pub guarded: bool,
}

impl Origins {
    /// Refuses a page that is not let in.
    pub fn check(&self, uri: &Uri, headers: &HeaderMap) -> Result<(), Status> {
        match headers.get(header::ORIGIN) {
            Some(origin) if !self.admit(origin, uri, headers) => {
                let origin = origin.to_str().unwrap_or("elsewhere");
                let message = format!(
                    "a page from {origin} may not call this service: serve it from the same host or name it (--allow-origin)"
                );
                Err(status::failure(Reason::OriginForbidden, message))
            }
            _ => Ok(()),
        }
    }

    /// Lets in pages that were named, and those from the same host at any port. A host name stands for the same host only
    /// if calls are guarded: anybody can make a name of theirs lead to this machine.
    fn admit(&self, origin: &HeaderValue, uri: &Uri, headers: &HeaderMap) -> bool {
        let Ok(origin) = origin.to_str() else { return false };
        if self.named.iter().any(|named| named == origin) {
            return true;
        }
        let Some(page) = origin.parse().ok().and_then(|origin: Uri| host_of(&origin)) else { return false };
        let asked = headers.get(header::HOST).and_then(|host| host.to_str().ok()?.parse().ok());
        let Some(here) = host_of(uri).or_else(|| host_of(&asked?)) else { return false };
        let is_address = page == "localhost" || address(&page).is_some();
        (page == here && (is_address || self.guarded)) || (is_loopback(&page) && is_loopback(&here))
    }

    /// Tells browsers so.
    pub fn layer(&self) -> CorsLayer {
        let origins = self.clone();
        let admit = move |origin: &HeaderValue, request: &Parts| origins.admit(origin, &request.uri, &request.headers);
        CorsLayer::new()
            .allow_origin(AllowOrigin::predicate(admit))
            .allow_methods([Method::GET, Method::POST])
            .allow_headers(AllowHeaders::mirror_request())
            .expose_headers(SHOWN.map(HeaderName::from_static))
            .max_age(REMEMBERED)
    }
}

fn host_of(uri: &Uri) -> Option<String> {
    uri.host().map(str::to_ascii_lowercase)
}

fn address(host: &str) -> Option<IpAddr> {
    host.trim_start_matches('[').trim_end_matches(']').parse().ok()
}

fn is_loopback(host: &str) -> bool {
    host == "localhost" || address(host).is_some_and(|address| address.is_loopback())
}
