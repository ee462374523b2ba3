//! Conversion of the planner's errors to gRPC statuses: one exhaustive match.

use crate::error::{Failure, PlannerError};
use std::time::Duration;
use surefoot_net::status;
use surefoot_planner::BuildError;
use surefoot_proto::reason::Reason;
use tonic::Status;

/// Typical duration of a build, sent as the retry delay when there are too many builds.
const BUILD_TIME: Duration = Duration::from_secs(5);
/// Typical time for which a store is unavailable, sent as the retry delay.
const RETRY_AFTER: Duration = Duration::from_secs(2);

impl From<PlannerError> for Status {
    fn from(error: PlannerError) -> Self {
        let message = error.to_string();
        match error {
            PlannerError::BadGraphId => status::invalid("graph_id", message),
            PlannerError::NoBuildId => status::invalid("build_id", message),
            PlannerError::NoReporter => status::invalid("reporter", message),
            PlannerError::UnknownGraph(id) | PlannerError::Unloaded(id) => {
                status::not_found(Reason::GraphNotFound, "graph", id, message)
            }
            PlannerError::UnknownBuild(id) => status::not_found(Reason::BuildNotFound, "build", id, message),
            PlannerError::UnknownVertex { vertex, .. } => {
                status::not_found(Reason::VertexNotFound, "vertex", vertex.to_string(), message)
            }
            PlannerError::UnknownLayer(name) => status::not_found(Reason::LayerNotFound, "layer", name, message),
            PlannerError::NotRequester(_) => status::failure(Reason::NotOwner, message),
            PlannerError::TooManyBuilds(_) | PlannerError::TooManyBuildsOfClient(_) => {
                status::retry(Reason::TooManyBuilds, BUILD_TIME, message)
            }
            PlannerError::OtherPolicy { .. } => status::failure(Reason::PolicyMismatch, message),
            PlannerError::Build(error) => build_status(&error),
            PlannerError::Level(error) => error.into(),
            PlannerError::Layer(_) => status::invalid("layer", message),
            PlannerError::RequestIdReused(_) => status::failure(Reason::RequestIdReused, message),
            PlannerError::LayersChanged => status::failure(Reason::LayersChanged, message),
            PlannerError::TooManyEdits { field, .. } => status::too_large(field, message),
            PlannerError::TooManyCells(_) => status::too_large("resolution", message),
            PlannerError::OutsideMap { field, .. } => status::invalid(field, message),
            PlannerError::LayersUnreadable(_) | PlannerError::Store { .. } => {
                status::failure(Reason::StoreFailed, message)
            }
            PlannerError::StoreUnavailable { .. } => status::retry(Reason::StoreUnavailable, RETRY_AFTER, message),
            PlannerError::RemoteBuildFailed(Failure { reason, message }) => {
                let known = Reason::ALL.iter().find(|known| known.name() == reason);
                status::failure(known.copied().unwrap_or(Reason::Internal), message)
            }
            PlannerError::Lost { .. } | PlannerError::BadReceipt => status::failure(Reason::Internal, message),
            PlannerError::ShuttingDown => surefoot_net::serving::shutting_down(),
        }
    }
}

fn build_status(error: &BuildError) -> Status {
    let message = error.to_string();
    match error {
        BuildError::TooManyRideStops { .. } => status::invalid("settings.vertices", message),
        BuildError::NoGround(_) => status::failure(Reason::NoGround, message),
        BuildError::Cancelled => status::failure(Reason::BuildCancelled, message),
    }
}
