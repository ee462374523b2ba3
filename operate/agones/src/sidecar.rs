//! The client of the sidecar: calls with a deadline, and their errors.

use crate::proto::beta::sdk_client::SdkClient as CounterClient;
use crate::proto::beta::{Counter, CounterUpdateRequest, GetCounterRequest, UpdateCounterRequest};
use crate::proto::sdk::Empty;
use crate::proto::sdk::sdk_client::SdkClient;
use std::future::Future;
use std::time::Duration;
use surefoot_net::client::{Credentials, Link, LinkError};
use tonic::{Code, Response, Status};

/// Longest time of a call, including connecting.
const CALL_LIMIT: Duration = Duration::from_secs(2);

/// Why a call of the sidecar failed.
#[derive(Debug, thiserror::Error)]
pub enum SidecarError {
    /// It is unreachable or does not answer in time; it may do so later.
    #[error("{0}")]
    Unreachable(String),
    /// It refuses. The codes tell no more: most refusals are UNKNOWN.
    #[error("{0}")]
    Refused(String),
}

impl From<Status> for SidecarError {
    fn from(status: Status) -> Self {
        let message = status.message().to_owned();
        match status.code() {
            Code::Unavailable | Code::DeadlineExceeded | Code::Cancelled => Self::Unreachable(message),
            _ => Self::Refused(message),
        }
    }
}

/// A connection to the sidecar, made by the first call and restored whenever it is lost.
#[derive(Debug, Clone)]
pub struct Sidecar {
    sdk: SdkClient<Link>,
    counters: CounterClient<Link>,
}

impl Sidecar {
    /// Prepares the connection to the sidecar at `uri`, such as `http://127.0.0.1:9357`.
    pub fn at(uri: &str) -> Result<Self, LinkError> {
        let link = Credentials::default().dial(uri)?.connect_lazy();
        Ok(Self { sdk: SdkClient::new(link.clone()), counters: CounterClient::new(link) })
    }

    /// Reports that the game server can be allocated.
    pub async fn ready(&mut self) -> Result<(), SidecarError> {
        in_time(self.sdk.ready(Empty {})).await.map(|_| ())
    }

    /// Reports that the game server is in use.
    pub async fn allocate(&mut self) -> Result<(), SidecarError> {
        in_time(self.sdk.allocate(Empty {})).await.map(|_| ())
    }

    /// Reports that the game server has ended, so that its pod may be deleted.
    pub async fn shutdown(&mut self) -> Result<(), SidecarError> {
        in_time(self.sdk.shutdown(Empty {})).await.map(|_| ())
    }

    /// Reports that the game server is healthy. Each ping is a stream of its own, whose answer shows that the sidecar
    /// is reachable.
    pub async fn health(&mut self) -> Result<(), SidecarError> {
        in_time(self.sdk.health(tokio_stream::once(Empty {}))).await.map(|_| ())
    }

    /// Sets the count of a counter.
    pub async fn set_count(&mut self, name: &str, count: i64) -> Result<(), SidecarError> {
        let request = CounterUpdateRequest { name: name.to_owned(), count: Some(count), capacity: None, count_diff: 0 };
        let request = UpdateCounterRequest { counter_update_request: Some(request) };
        in_time(self.counters.update_counter(request)).await.map(|_| ())
    }

    /// Returns the capacity of a counter.
    pub async fn capacity_of(&mut self, name: &str) -> Result<i64, SidecarError> {
        let Counter { capacity, .. } =
            in_time(self.counters.get_counter(GetCounterRequest { name: name.to_owned() })).await?;
        Ok(capacity)
    }
}

async fn in_time<T>(call: impl Future<Output = Result<Response<T>, Status>>) -> Result<T, SidecarError> {
    match tokio::time::timeout(CALL_LIMIT, call).await {
        Ok(answer) => Ok(answer?.into_inner()),
        Err(_) => Err(SidecarError::Unreachable(format!("no answer within {} s", CALL_LIMIT.as_secs()))),
    }
}
