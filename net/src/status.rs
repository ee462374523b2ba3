//! Statuses with details that a client can act on (`google.rpc`): a stable reason in every one, and, where it helps, which field,
//! which resource, which quota, and when to try again.

use std::time::Duration;
use surefoot_proto::reason::{DOMAIN, Reason};
use tonic::Status;
use tonic_types::{ErrorDetails, StatusExt};

/// A status with its reason and no further details.
pub fn failure(reason: Reason, message: impl Into<String>) -> Status {
    with_details(reason, message.into(), ErrorDetails::new())
}

/// A field of the request cannot be used.
pub fn invalid(field: impl Into<String>, message: impl Into<String>) -> Status {
    let message = message.into();
    with_details(Reason::InvalidField, message.clone(), ErrorDetails::with_bad_request_violation(field, message))
}

/// A field of the request asks for more than this service allows in one request; asking again does not help.
pub fn too_large(field: impl Into<String>, message: impl Into<String>) -> Status {
    let message = message.into();
    with_details(Reason::TooLarge, message.clone(), ErrorDetails::with_bad_request_violation(field, message))
}

/// There is no such thing; `kind` and `name` say what was looked for, such as `npc` and `7`.
pub fn not_found(reason: Reason, kind: &str, name: impl Into<String>, message: impl Into<String>) -> Status {
    let message = message.into();
    with_details(reason, message.clone(), ErrorDetails::with_resource_info(kind, name, "", message))
}

/// `subject` (such as `client:studio` or `server`) has as much as it may have. There is room again when something of it ends.
pub fn quota(reason: Reason, subject: impl Into<String>, message: impl Into<String>) -> Status {
    let message = message.into();
    with_details(reason, message.clone(), ErrorDetails::with_quota_failure_violation(subject, message))
}

/// The same call is likely to succeed after `after`.
pub fn retry(reason: Reason, after: Duration, message: impl Into<String>) -> Status {
    with_details(reason, message.into(), ErrorDetails::with_retry_info(Some(after)))
}

/// Gives a status that carries no reason the one that fits its code: those that the transport makes by itself.
pub fn with_reason(status: Status) -> Status {
    use tonic::Code;
    if status.code() == Code::Ok || Reason::of(&status).is_some() {
        return status;
    }
    let reason = match status.code() {
        Code::OutOfRange | Code::ResourceExhausted => Reason::TooLarge,
        Code::InvalidArgument => Reason::MalformedRequest,
        Code::Unimplemented => Reason::UnknownMethod,
        Code::DeadlineExceeded | Code::Cancelled => Reason::DeadlineExceeded,
        Code::Unauthenticated => Reason::TokenMissing,
        Code::PermissionDenied => Reason::RoleForbidden,
        Code::Unavailable => Reason::ShuttingDown,
        _ => Reason::Internal,
    };
    let mut details = status.get_error_details();
    details.set_error_info(reason.name(), DOMAIN, []);
    Status::with_error_details_and_metadata(status.code(), status.message(), details, status.metadata().clone())
}

fn with_details(reason: Reason, message: String, mut details: ErrorDetails) -> Status {
    details.set_error_info(reason.name(), DOMAIN, []);
    Status::with_error_details(reason.code(), message, details)
}
