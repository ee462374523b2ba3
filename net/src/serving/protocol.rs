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
    /// Every codec and framing.
    pub const ALL: [Self; 4] = [
        Self { codec: Codec::Json, is_stream: false },
        Self { codec: Codec::Proto, is_stream: false },
        Self { codec: Codec::Json, is_stream: true },
        Self { codec: Codec::Proto, is_stream: true },
    ];

    /// Returns the codec and framing of a request; `None` if it is not a Connect call.
    pub fn of(request: &Request) -> Option<Self> {
        if request.method() != Method::POST {
            return None;
        }
        let kind = request.headers().get(header::CONTENT_TYPE)?.to_str().ok()?;
        let kind = kind.split(';').next()?.trim();
        Self::ALL.into_iter().find(|call| call.content_type() == kind)
    }

    /// Content type of the call and of its answers.
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
            (StatusCode::from_u16(name_and_status(status.code()).1).expect("a status"), "application/json", body)
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
        let (code, details) = (name_and_status(status.code()).0, details.collect::<Vec<_>>());
        json!({ "code": code, "message": status.message(), "details": details })
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

/// The name and the HTTP status that Connect specifies for a code.
fn name_and_status(code: Code) -> (&'static str, u16) {
    match code {
        Code::Ok => ("ok", 200),
        Code::Cancelled => ("canceled", 499),
        Code::Unknown => ("unknown", 500),
        Code::InvalidArgument => ("invalid_argument", 400),
        Code::DeadlineExceeded => ("deadline_exceeded", 504),
        Code::NotFound => ("not_found", 404),
        Code::AlreadyExists => ("already_exists", 409),
        Code::PermissionDenied => ("permission_denied", 403),
        Code::ResourceExhausted => ("resource_exhausted", 429),
        Code::FailedPrecondition => ("failed_precondition", 400),
        Code::Aborted => ("aborted", 409),
        Code::OutOfRange => ("out_of_range", 400),
        Code::Unimplemented => ("unimplemented", 501),
        Code::Internal => ("internal", 500),
        Code::Unavailable => ("unavailable", 503),
        Code::DataLoss => ("data_loss", 500),
        Code::Unauthenticated => ("unauthenticated", 401),
    }
}
