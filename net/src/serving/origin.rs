//! The web pages that may call. Browsers send the origin of a page; other clients send none and pass.

use crate::status;
use axum::http::request::Parts;
use axum::http::{HeaderMap, HeaderValue, Method, Uri, header};
use std::net::IpAddr;
use std::sync::Arc;
use std::time::Duration;
use surefoot_proto::reason::Reason;
use tonic::Status;
use tower_http::cors::{AllowHeaders, AllowOrigin, CorsLayer};

/// How long a browser may cache the answer to a preflight request.
const PREFLIGHT_MAX_AGE: Duration = Duration::from_secs(600);

/// The origins whose pages may call.
#[derive(Debug, Clone, Default)]
pub(super) struct Origins {
    /// Configured origins, such as `https://studio.example`.
    pub named: Arc<[String]>,
    /// Whether TLS or tokens protect the endpoint. If so, a page may call the host name that it was loaded from.
    pub guarded: bool,
}

impl Origins {
    /// Refuses requests of pages that may not call.
    pub fn check(&self, uri: &Uri, headers: &HeaderMap) -> Result<(), Status> {
        match headers.get(header::ORIGIN) {
            Some(origin) if !self.admit(origin, uri, headers) => {
                let origin = origin.to_str().unwrap_or("elsewhere");
                let message = format!(
                    "a page from {origin} may not call this service: serve the page from the same host, or allow its \
                     origin (--allow-origin)"
                );
                Err(status::failure(Reason::OriginForbidden, message))
            }
            _ => Ok(()),
        }
    }

    /// Whether a page of `origin` may call: the configuration lists it, or it comes from the same host, at any port. A
    /// host name counts as the same host only if the endpoint is guarded, because a foreign name may resolve to this
    /// machine.
    fn admit(&self, origin: &HeaderValue, uri: &Uri, headers: &HeaderMap) -> bool {
        let Ok(origin) = origin.to_str() else { return false };
        if self.named.iter().any(|named| named == origin) {
            return true;
        }
        let Some(page) = origin.parse().ok().and_then(|origin: Uri| host_of(&origin)) else { return false };
        let requested = headers.get(header::HOST).and_then(|host| host.to_str().ok()?.parse().ok());
        let Some(here) = host_of(uri).or_else(|| host_of(&requested?)) else { return false };
        let is_address = page == "localhost" || address(&page).is_some();
        (page == here && (is_address || self.guarded)) || (is_loopback(&page) && is_loopback(&here))
    }

    /// The CORS layer, which browsers enforce.
    pub fn layer(&self) -> CorsLayer {
        let origins = self.clone();
        let admit = move |origin: &HeaderValue, request: &Parts| origins.admit(origin, &request.uri, &request.headers);
        CorsLayer::new()
            .allow_origin(AllowOrigin::predicate(admit))
            .allow_methods([Method::GET, Method::POST])
            .allow_headers(AllowHeaders::mirror_request())
            .max_age(PREFLIGHT_MAX_AGE)
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
