//! Statuses with details that a client can act on (`google.rpc`): always a stable reason and, where it helps, the
//! field, the resource, the quota, or when to retry.

use std::time::Duration;
use surefoot_proto::reason::{DOMAIN, Reason};
use tonic::{Response, Status};
use tonic_types::{ErrorDetails, StatusExt};

/// What a method of a service returns.
pub type Answer<T> = Result<Response<T>, Status>;

/// Message of tonic's status for a call that has exceeded its deadline.
const TIMEOUT: &str = "Timeout expired";

/// Returns a status with a reason and no further details.
pub fn failure(reason: Reason, message: impl Into<String>) -> Status {
    with_details(reason, message.into(), ErrorDetails::new())
}

/// Returns the status for a field of the request that cannot be used.
pub fn invalid(field: impl Into<String>, message: impl Into<String>) -> Status {
    let message = message.into();
    with_details(Reason::InvalidField, message.clone(), ErrorDetails::with_bad_request_violation(field, message))
}

/// Returns the status for a field of the request that exceeds a limit of this service; a retry does not help.
pub fn too_large(field: impl Into<String>, message: impl Into<String>) -> Status {
    let message = message.into();
    with_details(Reason::TooLarge, message.clone(), ErrorDetails::with_bad_request_violation(field, message))
}

/// Returns the status for a resource that does not exist; `kind` and `name` identify it, such as `npc` and `7`.
pub fn not_found(reason: Reason, kind: &str, name: impl Into<String>, message: impl Into<String>) -> Status {
    let message = message.into();
    with_details(reason, message.clone(), ErrorDetails::with_resource_info(kind, name, "", message))
}

/// Returns the status for an exhausted quota of `subject` (such as `client:studio` or `server`). Quota is freed only
/// when one of the subject's resources ends.
pub fn quota(reason: Reason, subject: impl Into<String>, message: impl Into<String>) -> Status {
    let message = message.into();
    with_details(reason, message.clone(), ErrorDetails::with_quota_failure_violation(subject, message))
}

/// Returns the status for a world that runs on the server at `address`.
pub fn elsewhere(world: impl Into<String>, address: &str) -> Status {
    let (reason, world) = (Reason::WorldElsewhere, world.into());
    let message = format!("world {world} runs on {address}");
    let mut details = ErrorDetails::with_resource_info("world", world, "", &message);
    details.set_error_info(reason.name(), DOMAIN, [("address".to_owned(), address.to_owned())]);
    Status::with_error_details(reason.code(), message, details)
}

/// Returns the status for a call that is likely to succeed if it is repeated after `after`.
pub fn retry(reason: Reason, after: Duration, message: impl Into<String>) -> Status {
    with_details(reason, message.into(), ErrorDetails::with_retry_info(Some(after)))
}

/// Adds a reason by its code to a status that has none, such as a status of the transport.
pub fn with_reason(status: Status) -> Status {
    use tonic::Code;
    if status.code() == Code::Ok || Reason::of(&status).is_some() {
        return status;
    }
    // tonic ends calls that exceed their own deadlines as CANCELLED.
    let is_late = status.code() == Code::Cancelled && status.message() == TIMEOUT;
    let code = if is_late { Code::DeadlineExceeded } else { status.code() };
    let reason = match code {
        Code::OutOfRange | Code::ResourceExhausted => Reason::TooLarge,
        Code::InvalidArgument => Reason::MalformedRequest,
        Code::Unimplemented => Reason::UnknownMethod,
        Code::DeadlineExceeded => Reason::DeadlineExceeded,
        Code::Cancelled => Reason::Cancelled,
        Code::Unauthenticated => Reason::TokenMissing,
        Code::PermissionDenied => Reason::RoleForbidden,
        Code::Unavailable => Reason::ShuttingDown,
        _ => Reason::Internal,
    };
    let mut details = status.get_error_details();
    details.set_error_info(reason.name(), DOMAIN, []);
    Status::with_error_details_and_metadata(code, status.message(), details, status.metadata().clone())
}

fn with_details(reason: Reason, message: String, mut details: ErrorDetails) -> Status {
    details.set_error_info(reason.name(), DOMAIN, []);
    Status::with_error_details(reason.code(), message, details)
}
