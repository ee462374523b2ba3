//! What every request passes before a service sees it: who calls, may they, and by when must there be an answer.

use super::access::{Access, access};
use super::origin::Origins;
use super::tokens::Tokens;
use axum::body::Body;
use axum::extract::{Request, State};
use axum::http::{HeaderValue, Method, StatusCode, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use std::sync::Arc;
use std::time::Duration;
use tonic::Status;
use tonic::transport::server::{TcpConnectInfo, TlsConnectInfo};
use tower_service::Service;
use tracing::{Instrument, info_span};

/// Who makes a request: an extension of every request.
#[derive(Debug, Clone, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Caller {
    /// Name of the token; without tokens the address of the peer, without its port.
    pub name: Arc<str>,
}

/// What the gate knows.
#[derive(Debug)]
pub(super) struct Gate {
    pub tokens: Option<Tokens>,
    pub origins: Origins,
    pub default_deadline: Duration,
}

/// Lets a request through to its service, or answers it.
pub(super) async fn pass(State(gate): State<Arc<Gate>>, mut request: Request, next: Next) -> Response {
    let is_web = content_type(&request).is_some_and(|kind| kind.as_bytes().starts_with(b"application/grpc-web"));
    let web_kind = content_type(&request).filter(|_| is_web).cloned();
    let caller = match gate.admit(&request) {
        Ok(caller) => caller,
        Err(status) if request.uri().path() == "/metrics" => return refuse_page(&status),
        Err(status) => return refuse(status, web_kind),
    };
    let span = info_span!("rpc", method = request.uri().path(), caller = &*caller.name);
    request.extensions_mut().insert(caller);
    let has_deadline = request.headers().contains_key("grpc-timeout");
    let answer = next.run(request).instrument(span);
    if has_deadline {
        // tonic itself heeds it.
        return answer.await;
    }
    match tokio::time::timeout(gate.default_deadline, answer).await {
        Ok(response) => response,
        Err(_) => {
            let limit = gate.default_deadline.as_secs_f64();
            let status = Status::deadline_exceeded(format!(
                "no answer within {limit} s, the default (--default-deadline): ask with a deadline of your own"
            ));
            refuse(status, web_kind)
        }
    }
}

impl Gate {
    fn admit(&self, request: &Request) -> Result<Caller, Status> {
        self.origins.check(request.uri(), request.headers())?;
        let peer = || Caller { name: peer(request).into() };
        let Some(tokens) = &self.tokens else { return Ok(peer()) };
        let access = access(request.uri().path());
        // What is no method of a service is a page, or nothing.
        let is_service = ["/surefoot.", "/grpc."].iter().any(|start| request.uri().path().starts_with(start));
        let is_page = is_read(request.method()) && !is_service && access == Access::Roles(&[]);
        if is_page || access == Access::Open {
            return Ok(peer());
        }
        let secret = bearer(request).ok_or_else(|| {
            Status::unauthenticated("a token is needed: send `authorization: Bearer SECRET` (--token)")
        })?;
        let (name, role) =
            tokens.holder(secret).ok_or_else(|| Status::unauthenticated("the token is not one that is known here"))?;
        match access {
            Access::Roles(roles) if !roles.contains(&role) => Err(Status::permission_denied(format!(
                "`{name}` is a {} and may not call {}",
                role.name(),
                request.uri().path()
            ))),
            _ => Ok(Caller { name }),
        }
    }
}

fn is_read(method: &Method) -> bool {
    [Method::GET, Method::HEAD].contains(method)
}

/// Answers what no service does: from the pages if it is read, as a call of an unknown method otherwise.
pub(super) async fn page(mut pages: axum::Router, request: Request) -> Response {
    if is_read(request.method()) {
        return pages.call(request).await.into_response();
    }
    let path = request.uri().path();
    Status::unimplemented(format!("{path} is no method of this service")).into_http()
}

fn content_type(request: &Request) -> Option<&HeaderValue> {
    request.headers().get(header::CONTENT_TYPE)
}

/// The secret of an `authorization: Bearer` header.
fn bearer(request: &Request) -> Option<&str> {
    let (scheme, secret) = request.headers().get(header::AUTHORIZATION)?.to_str().ok()?.split_once(' ')?;
    scheme.eq_ignore_ascii_case("bearer").then(|| secret.trim())
}

fn peer(request: &Request) -> String {
    let extensions = request.extensions();
    let plain = extensions.get::<TcpConnectInfo>().and_then(TcpConnectInfo::remote_addr);
    let secured = || extensions.get::<TlsConnectInfo<TcpConnectInfo>>()?.get_ref().remote_addr();
    plain.or_else(secured).map_or_else(|| "unknown".to_owned(), |address| address.ip().to_canonical().to_string())
}

/// A status as an answer; one of gRPC-Web says so.
fn refuse(status: Status, web_kind: Option<HeaderValue>) -> Response {
    let mut response = status.into_http::<Body>();
    if let Some(kind) = web_kind {
        response.headers_mut().insert(header::CONTENT_TYPE, kind);
    }
    response
}

/// A status as an answer to a plain HTTP request.
fn refuse_page(status: &Status) -> Response {
    if status.code() == tonic::Code::PermissionDenied {
        return (StatusCode::FORBIDDEN, format!("{}\n", status.message())).into_response();
    }
    let wanted = [(header::WWW_AUTHENTICATE, "Bearer")];
    (StatusCode::UNAUTHORIZED, wanted, format!("{}\n", status.message())).into_response()
}
