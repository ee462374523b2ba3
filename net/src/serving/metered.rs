//! Counts the bytes of large requests against the memory budget while they arrive and until they are answered.

use crate::memory::{MemoryBudget, Reservation};
use axum::body::{Body, Bytes, HttpBody};
use axum::extract::Request;
use http_body::Frame;
use parking_lot::Mutex;
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll, ready};
use tonic::Status;

/// Requests up to this size are not counted, bytes.
pub(super) const SMALL_BYTES: usize = 64 << 10;
/// Copies of a request that exist at a time: received, decoded and translated.
const COPIES: u64 = 3;

/// The reservation of a request, to be held until it is answered.
pub(super) type Held = Arc<Mutex<Option<Reservation>>>;

/// Counts the bytes of a request for `client` as they arrive. If the budget is exhausted, the request fails with
/// RESOURCE_EXHAUSTED.
pub(super) fn meter(request: Request, memory: &MemoryBudget, client: &Arc<str>) -> (Request, Held) {
    let held = Held::default();
    let counting = (memory.clone(), client.clone(), held.clone());
    (request.map(|body| Body::new(Metered { body, seen: 0, counting })), held)
}

struct Metered {
    body: Body,
    /// Bytes that have arrived.
    seen: usize,
    counting: (MemoryBudget, Arc<str>, Held),
}

impl Metered {
    fn count(&mut self, bytes: usize) -> Result<(), Status> {
        self.seen += bytes;
        if self.seen <= SMALL_BYTES {
            return Ok(());
        }
        let (memory, client, held) = &self.counting;
        let (mut held, wanted) = (held.lock(), COPIES * self.seen as u64);
        match &mut *held {
            Some(reservation) => reservation.resize(wanted)?,
            None => *held = Some(memory.reserve(client, wanted)?),
        }
        Ok(())
    }
}

impl HttpBody for Metered {
    type Data = Bytes;
    type Error = axum::Error;

    fn poll_frame(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
    ) -> Poll<Option<Result<Frame<Bytes>, axum::Error>>> {
        let frame = ready!(Pin::new(&mut self.body).poll_frame(context));
        if let Some(Ok(frame)) = &frame
            && let Some(data) = frame.data_ref()
            && let Err(status) = self.count(data.len())
        {
            self.body = Body::empty();
            return Poll::Ready(Some(Err(axum::Error::new(status))));
        }
        Poll::Ready(frame)
    }

    fn is_end_stream(&self) -> bool {
        self.body.is_end_stream()
    }

    fn size_hint(&self) -> http_body::SizeHint {
        self.body.size_hint()
    }
}
