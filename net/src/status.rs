//! Statuses with details that a client can act on (`google.rpc`): which field, which resource, when to try again.

use std::time::Duration;
use tonic::{Code, Status};
use tonic_types::{ErrorDetails, StatusExt};

/// When to ask again after something was full or away.
const RETRY_AFTER: Duration = Duration::from_secs(1);

/// A field of the request cannot be used.
pub fn invalid(field: impl Into<String>, message: impl Into<String>) -> Status {
    field_violation(Code::InvalidArgument, field, message)
}

/// A field of the request asks for more than this service allows in one request; asking again does not help.
pub fn too_much(field: impl Into<String>, message: impl Into<String>) -> Status {
    field_violation(Code::ResourceExhausted, field, message)
}

fn field_violation(code: Code, field: impl Into<String>, message: impl Into<String>) -> Status {
    let message = message.into();
    Status::with_error_details(code, message.clone(), ErrorDetails::with_bad_request_violation(field, message))
}

/// There is no such thing; `kind` and `name` say what was looked for, such as `npc` and `7`.
pub fn not_found(kind: &str, name: impl Into<String>, message: impl Into<String>) -> Status {
    let message = message.into();
    let details = ErrorDetails::with_resource_info(kind, name, "", message.clone());
    Status::with_error_details(Code::NotFound, message, details)
}

/// Something is full just now; it may have room later.
pub fn exhausted(message: impl Into<String>) -> Status {
    retry(Code::ResourceExhausted, message)
}

/// The service is away just now.
pub fn unavailable(message: impl Into<String>) -> Status {
    retry(Code::Unavailable, message)
}

fn retry(code: Code, message: impl Into<String>) -> Status {
    Status::with_error_details(code, message, ErrorDetails::with_retry_info(Some(RETRY_AFTER)))
}
