//! From the planner's errors to statuses: one match, exhaustive.

use crate::error::PlannerError;
use surefoot_net::status;
use surefoot_planner::BuildError;
use tonic::Status;

impl From<PlannerError> for Status {
    fn from(error: PlannerError) -> Self {
        let message = error.to_string();
        match error {
            PlannerError::BadGraphId => status::invalid("graph_id", message),
            PlannerError::UnknownGraph(id) | PlannerError::Unloaded(id) => status::not_found("graph", id, message),
            PlannerError::UnknownVertex { vertex, .. } => status::not_found("vertex", vertex.to_string(), message),
            PlannerError::UnknownLayer(name) => status::not_found("layer", name, message),
            PlannerError::TooManyBuilds(_) => status::exhausted(message),
            PlannerError::Build(error) => build_status(&error),
            PlannerError::Level(error) => error.into(),
            PlannerError::Layer(_) => status::invalid("layer", message),
            PlannerError::Overtaken => Status::aborted(message),
            PlannerError::Store { .. } | PlannerError::Lost { .. } => Status::internal(message),
            PlannerError::ShuttingDown => status::unavailable(message),
        }
    }
}

fn build_status(error: &BuildError) -> Status {
    let message = error.to_string();
    match error {
        BuildError::NoGround(_) => Status::failed_precondition(message),
        BuildError::Cancelled => Status::cancelled(message),
    }
}
