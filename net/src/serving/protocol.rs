//! Framing, content types and errors of the Connect protocol. gRPC has the same frames.

use axum::body::Body;
use axum::extract::Request;
use axum::http::{HeaderValue, Method, Response, StatusCode, header};
use base64::Engine;
use base64::engine::general_purpose::STANDARD_NO_PAD;
use prost::Message;
use serde_json::{Value, json};
use tonic::{Code, Status};
use tonic_types::StatusExt;

/// Length of the prefix of each message of gRPC and of Connect streams, bytes: flags and length.
pub(super) const FRAME: usize = 5;
/// Flag of the last frame of a Connect stream.
pub(super) const END: u8 = 2;

/// Returns a message with its frame prefix.
pub(super) fn framed(flags: u8, message: &[u8]) -> Vec<u8> {
    let len = u32::try_from(message.len()).expect("messages are far smaller than 4 GiB");
    [&[flags][..], &len.to_be_bytes(), message].concat()
}

/// Encoding of messages.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Codec {
    /// The canonical JSON of protobuf.
    Json,
    /// Binary protobuf.
    Proto,
}

/// A call in the Connect protocol.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Connect {
    pub codec: Codec,
    /// Whether messages are framed, as in streams.
    pub is_stream: bool,
}

impl Connect {
    /// Returns the codec and framing of a request; `None` if it is not a Connect call.
    pub fn of(request: &Request) -> Option<Self> {
        if request.method() != Method::POST {
            return None;
        }
        let kind = request.headers().get(header::CONTENT_TYPE)?.to_str().ok()?;
        let (codec, is_stream) = match kind.split(';').next()?.trim() {
            "application/json" => (Codec::Json, false),
            "application/proto" => (Codec::Proto, false),
            "application/connect+json" => (Codec::Json, true),
            "application/connect+proto" => (Codec::Proto, true),
            _ => return None,
        };
        Some(Self { codec, is_stream })
    }

    /// Content type of the call's answers.
    pub fn content_type(self) -> &'static str {
        match (self.codec, self.is_stream) {
            (Codec::Json, false) => "application/json",
            (Codec::Proto, false) => "application/proto",
            (Codec::Json, true) => "application/connect+json",
            (Codec::Proto, true) => "application/connect+proto",
        }
    }

    /// Returns the answer to a call that failed.
    pub fn refuse(self, status: &Status) -> Response<Body> {
        let error = Self::error(status);
        let (code, kind, body) = if self.is_stream {
            let end = serde_json::to_vec(&json!({ "error": error })).expect("plain data");
            (StatusCode::OK, self.content_type(), framed(END, &end))
        } else {
            let body = serde_json::to_vec(&error).expect("plain data");
            (http_status(status.code()), "application/json", body)
        };
        let mut response = Response::new(Body::from(body));
        *response.status_mut() = code;
        response.headers_mut().insert(header::CONTENT_TYPE, HeaderValue::from_static(kind));
        response
    }

    /// Encodes a failure as Connect's JSON.
    pub fn error(status: &Status) -> Value {
        let known = debug(status);
        let details = RpcStatus::decode(status.details()).unwrap_or_default().details.into_iter().map(|detail| {
            let name = detail.type_url.rsplit('/').next().unwrap_or_default();
            let mut shown = json!({ "type": name, "value": STANDARD_NO_PAD.encode(&detail.value) });
            if let Some((_, debug)) = known.iter().find(|(known, _)| *known == name) {
                shown["debug"] = debug.clone();
            }
            shown
        });
        json!({ "code": code_name(status.code()), "message": status.message(), "details": details.collect::<Vec<_>>() })
    }
}

/// The only field of `google.rpc.Status` that is read.
#[derive(Clone, PartialEq, Message)]
struct RpcStatus {
    #[prost(message, repeated, tag = "3")]
    details: Vec<prost_types::Any>,
}

/// Returns the details of a status as JSON, each with the name of its type.
fn debug(status: &Status) -> Vec<(&'static str, Value)> {
    let details = status.get_error_details();
    let mut known = Vec::new();
    if let Some(info) = details.error_info() {
        known.push(("google.rpc.ErrorInfo", json!({ "reason": info.reason, "domain": info.domain })));
    }
    if let Some(request) = details.bad_request() {
        let fields = request.field_violations.iter();
        let fields: Vec<_> = fields.map(|it| json!({ "field": it.field, "description": it.description })).collect();
        known.push(("google.rpc.BadRequest", json!({ "fieldViolations": fields })));
    }
    if let Some(delay) = details.retry_info().and_then(|info| info.retry_delay) {
        known.push(("google.rpc.RetryInfo", json!({ "retryDelay": format!("{}s", delay.as_secs_f64()) })));
    }
    if let Some(resource) = details.resource_info() {
        let shown = json!({ "resourceType": resource.resource_type, "resourceName": resource.resource_name });
        known.push(("google.rpc.ResourceInfo", shown));
    }
    if let Some(quota) = details.quota_failure() {
        let violations = quota.violations.iter();
        let violations: Vec<_> =
            violations.map(|it| json!({ "subject": it.subject, "description": it.description })).collect();
        known.push(("google.rpc.QuotaFailure", json!({ "violations": violations })));
    }
    known
}

fn code_name(code: Code) -> &'static str {
    match code {
        Code::Ok => "ok",
        Code::Cancelled => "canceled",
        Code::Unknown => "unknown",
        Code::InvalidArgument => "invalid_argument",
        Code::DeadlineExceeded => "deadline_exceeded",
        Code::NotFound => "not_found",
        Code::AlreadyExists => "already_exists",
        Code::PermissionDenied => "permission_denied",
        Code::ResourceExhausted => "resource_exhausted",
        Code::FailedPrecondition => "failed_precondition",
        Code::Aborted => "aborted",
        Code::OutOfRange => "out_of_range",
        Code::Unimplemented => "unimplemented",
        Code::Internal => "internal",
        Code::Unavailable => "unavailable",
        Code::DataLoss => "data_loss",
        Code::Unauthenticated => "unauthenticated",
    }
}

/// The HTTP status that Connect specifies for a code.
fn http_status(code: Code) -> StatusCode {
    match code {
        Code::Ok => StatusCode::OK,
        Code::Cancelled => StatusCode::from_u16(499).expect("a status"),
        Code::InvalidArgument | Code::FailedPrecondition | Code::OutOfRange => StatusCode::BAD_REQUEST,
        Code::DeadlineExceeded => StatusCode::GATEWAY_TIMEOUT,
        Code::NotFound => StatusCode::NOT_FOUND,
        Code::AlreadyExists | Code::Aborted => StatusCode::CONFLICT,
        Code::PermissionDenied => StatusCode::FORBIDDEN,
        Code::ResourceExhausted => StatusCode::TOO_MANY_REQUESTS,
        Code::Unimplemented => StatusCode::NOT_IMPLEMENTED,
        Code::Unavailable => StatusCode::SERVICE_UNAVAILABLE,
        Code::Unauthenticated => StatusCode::UNAUTHORIZED,
        Code::Unknown | Code::Internal | Code::DataLoss => StatusCode::INTERNAL_SERVER_ERROR,
    }
}
