//! Checks each request before a service sees it: the caller, its role, and the deadline.

use super::access::{Access, Role, access};
use super::deadline::{self, Deadline};
use super::incoming::ConnectionInfo;
use super::limits::Limits;
use super::metered::meter;
use super::methods::takes_stream;
use super::origin::Origins;
use super::protocol::Connect;
use super::tokens::{Holder, Tokens};
use crate::memory::MemoryBudget;
use crate::status;
use axum::body::Body;
use axum::extract::{Request, State};
use axum::http::{Method, StatusCode, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use std::sync::Arc;
use std::time::Duration;
use surefoot_proto::reason::Reason;
use tokio::sync::watch;
use tonic::Status;
use tonic::transport::server::TlsConnectInfo;
use tower_service::Service;
use tracing::{Instrument, info_span};

/// The caller of a request: an extension of each request.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Caller {
    /// Name of the token; without tokens, the peer's IP address.
    pub name: Arc<str>,
    /// Role of the token; `None` on an endpoint without tokens, where any caller may do everything.
    role: Option<Role>,
}

impl Caller {
    /// The caller of a request that has passed the gate.
    pub fn of<T>(request: &tonic::Request<T>) -> Self {
        // Requests built in tests get the role Client.
        let unknown = || Self { name: "unknown".into(), role: Some(Role::Client) };
        request.extensions().get::<Self>().cloned().unwrap_or_else(unknown)
    }

    /// The service itself, which restores the objects of a client.
    pub fn on_behalf_of(name: &str) -> Self {
        Self { name: name.into(), role: None }
    }

    /// Whether the caller may change or remove objects of `owner`.
    pub fn may_change(&self, owner: &str) -> bool {
        matches!(self.role, None | Some(Role::Admin)) || *self.name == *owner
    }

    /// Whether reports of the caller count in full: workers and admins see NPCs move. Without tokens, every caller is
    /// an admin.
    pub fn is_trusted_reporter(&self) -> bool {
        matches!(self.role, None | Some(Role::Worker | Role::Admin))
    }

    /// Whether the caller may add to objects of `owner`, as designers do to the worlds of games.
    pub fn may_add_to(&self, owner: &str) -> bool {
        self.may_change(owner) || self.role == Some(Role::Designer)
    }
}

/// The configuration that requests are checked against.
#[derive(Debug)]
pub(super) struct Gate {
    pub tokens: Option<Tokens>,
    pub origins: Origins,
    pub limits: Limits,
    /// Budget for large requests.
    pub memory: MemoryBudget,
    /// False while the service is starting.
    pub ready: watch::Receiver<bool>,
}

/// Retry delay for callers while the service is starting.
const START_TIME: Duration = Duration::from_secs(1);

/// Lets a request through to its service, or answers it.
pub(super) async fn pass(State(gate): State<Arc<Gate>>, mut request: Request, next: Next) -> Response {
    let protocol = Protocol::of(&request);
    let deadline = match protocol.deadline(&request, &gate.limits) {
        Ok(deadline) => deadline,
        Err(status) => return protocol.refuse(status),
    };
    let admitted = gate.admit(&request).and_then(|admitted| gate.check_ready(&request).map(|()| admitted));
    let (caller, holder) = match admitted {
        Ok(admitted) => admitted,
        Err(status) if request.uri().path() == "/metrics" => return refuse_page(&status),
        Err(status) => return protocol.refuse(status),
    };
    let span = info_span!("rpc", method = request.uri().path(), caller = &*caller.name);
    request.extensions_mut().insert(caller.clone());
    if let Some(holder) = holder {
        request.extensions_mut().insert(holder);
    }
    // A stream of requests is never in memory as a whole; the message limit bounds it.
    let is_metered = request.method() == Method::POST && !takes_stream(request.uri().path());
    let (request, _held) = match is_metered {
        true => meter(request, &gate.memory, &caller.name),
        false => (request, Default::default()),
    };
    let answer = async { with_reason(next.run(request).await) }.instrument(span);
    match tokio::time::timeout(deadline.after, answer).await {
        Ok(response) => response,
        Err(_) => protocol.refuse(deadline.missed()),
    }
}

/// Adds the reason to a refusal that the transport created itself, such as for a message that is too large.
fn with_reason(mut response: Response) -> Response {
    let Some(status) = Status::from_header_map(response.headers()) else { return response };
    let status = status::with_reason(status);
    // If the status does not fit into headers, the response is not changed.
    let _ = status.add_header(response.headers_mut());
    response
}

impl Gate {
    fn admit(&self, request: &Request) -> Result<(Caller, Option<Holder>), Status> {
        self.origins.check(request.uri(), request.headers())?;
        let peer = || Caller { name: peer(request).into(), role: None };
        let note_authorized = || connection(request).into_iter().for_each(ConnectionInfo::note_authorized);
        let Some(tokens) = &self.tokens else {
            note_authorized();
            return Ok((peer(), None));
        };
        let access = access(request.uri().path());
        // A path outside the services is a page, or does not exist.
        let is_service = ["/surefoot.", "/grpc."].iter().any(|start| request.uri().path().starts_with(start));
        let is_page = is_read(request.method()) && !is_service && access == Access::Roles(&[]);
        if is_page || access == Access::Open {
            return Ok((peer(), None));
        }
        let secret = bearer(request).ok_or_else(|| {
            status::failure(Reason::TokenMissing, "a token is required: send `authorization: Bearer SECRET` (--token)")
        })?;
        let holder = tokens.holder(secret);
        let holder =
            holder.ok_or_else(|| status::failure(Reason::TokenUnknown, "the token is unknown to this service"))?;
        let (name, role) = holder.caller();
        match access {
            Access::Roles(roles) if !roles.contains(&role) => {
                let path = request.uri().path();
                Err(status::failure(Reason::RoleForbidden, format!("`{name}` is a {role} and may not call {path}")))
            }
            _ => {
                note_authorized();
                Ok((Caller { name, role: Some(role) }, Some(holder)))
            }
        }
    }

    /// Refuses calls of services while they are starting.
    fn check_ready(&self, request: &Request) -> Result<(), Status> {
        if *self.ready.borrow() || !request.uri().path().starts_with("/surefoot.") {
            return Ok(());
        }
        Err(status::retry(Reason::Starting, START_TIME, "the service is starting: retry in a second"))
    }
}

fn is_read(method: &Method) -> bool {
    [Method::GET, Method::HEAD].contains(method)
}

/// Answers a request that no service handles: GET and HEAD with a page, others as a call of an unknown method.
pub(super) async fn page(mut pages: axum::Router, request: Request) -> Response {
    if is_read(request.method()) {
        return pages.call(request).await.into_response();
    }
    let path = request.uri().path();
    status::failure(Reason::UnknownMethod, format!("{path} is not a method of this service")).into_http()
}

/// The secret of an `authorization: Bearer` header.
fn bearer(request: &Request) -> Option<&str> {
    let (scheme, secret) = request.headers().get(header::AUTHORIZATION)?.to_str().ok()?.split_once(' ')?;
    scheme.eq_ignore_ascii_case("bearer").then(|| secret.trim())
}

/// The connection of a request.
fn connection(request: &Request) -> Option<&ConnectionInfo> {
    let extensions = request.extensions();
    let secured = || Some(extensions.get::<TlsConnectInfo<ConnectionInfo>>()?.get_ref());
    extensions.get::<ConnectionInfo>().or_else(secured)
}

fn peer(request: &Request) -> String {
    let address = connection(request).and_then(|connection| connection.peer);
    address.map_or_else(|| "unknown".to_owned(), |address| address.ip().to_canonical().to_string())
}

/// Protocol of a call, which determines how a refusal is encoded.
enum Protocol {
    Grpc,
    Connect(Connect),
}

impl Protocol {
    fn of(request: &Request) -> Self {
        Connect::of(request).map_or(Self::Grpc, Self::Connect)
    }

    /// The deadline of a call. Only the header of its protocol counts.
    fn deadline(&self, request: &Request, limits: &Limits) -> Result<Deadline, Status> {
        let own = match self {
            Self::Connect(_) => deadline::of_connect(request.headers())?,
            Self::Grpc => deadline::of_grpc(request.headers()),
        };
        Ok(Deadline::new(own, limits))
    }

    fn refuse(self, status: Status) -> Response {
        match self {
            Self::Grpc => status.into_http::<Body>(),
            Self::Connect(connect) => connect.refuse(&status),
        }
    }
}

/// Refuses a plain HTTP request with a status.
fn refuse_page(status: &Status) -> Response {
    if status.code() == tonic::Code::PermissionDenied {
        return (StatusCode::FORBIDDEN, format!("{}\n", status.message())).into_response();
    }
    let wanted = [(header::WWW_AUTHENTICATE, "Bearer")];
    (StatusCode::UNAUTHORIZED, wanted, format!("{}\n", status.message())).into_response()
}
