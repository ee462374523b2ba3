//! Redirects callers to the server that has a world, in a fleet.
//!
//! Calls about worlds of other servers fail with NOT_FOUND. This layer looks such worlds up, and replaces the status.

use crate::ids::{NpcId, WorldId};
use crate::worlds::Worlds;
use std::convert::Infallible;
use std::pin::Pin;
use std::task::{Context, Poll};
use surefoot_proto::reason::Reason;
use tonic::body::Body;
use tonic::codegen::{Service, http};
use tonic::server::NamedService;
use tonic::{Code, Status};
use tonic_types::StatusExt;

/// Adds redirects to a service.
#[derive(Debug, Clone)]
pub struct RedirectToOwner<S> {
    pub inner: S,
    pub worlds: Worlds,
}

impl<S: NamedService> NamedService for RedirectToOwner<S> {
    const NAME: &'static str = S::NAME;
}

impl<S> Service<http::Request<Body>> for RedirectToOwner<S>
where
    S: Service<http::Request<Body>, Response = http::Response<Body>, Error = Infallible>,
    S::Future: Send + 'static,
{
    type Response = http::Response<Body>;
    type Error = Infallible;
    type Future = Pin<Box<dyn Future<Output = Result<Self::Response, Infallible>> + Send>>;

    fn poll_ready(&mut self, context: &mut Context<'_>) -> Poll<Result<(), Infallible>> {
        self.inner.poll_ready(context)
    }

    fn call(&mut self, request: http::Request<Body>) -> Self::Future {
        let answer = self.inner.call(request);
        if self.worlds.shared_store().is_none() {
            return Box::pin(answer);
        }
        let worlds = self.worlds.clone();
        Box::pin(async move {
            let answer = answer.await?;
            match not_here(&answer) {
                Some(id) => {
                    let found = worlds.whereabouts(id).await;
                    Ok(found.map_or(answer, |found| Status::from(found.error(id)).into_http()))
                }
                None => Ok(answer),
            }
        })
    }
}

/// The world that was not found, by the status of an answer.
fn not_here(answer: &http::Response<Body>) -> Option<WorldId> {
    let status = Status::from_header_map(answer.headers()).filter(|status| status.code() == Code::NotFound)?;
    let id = status.get_details_resource_info()?.resource_name.parse().ok()?;
    match Reason::of(&status)? {
        Reason::WorldNotFound => Some(WorldId(id)),
        Reason::NpcNotFound => Some(NpcId(id).world()),
        _ => None,
    }
}
