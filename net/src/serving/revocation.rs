//! Ends running calls whose token is removed: requests and answers end with UNAUTHENTICATED.

use super::tokens::Holder;
use crate::status;
use axum::body::{Body, Bytes, HttpBody};
use axum::extract::Request;
use axum::http::{HeaderMap, Response, header};
use axum::middleware::Next;
use http_body::Frame;
use std::future::Future;
use std::pin::Pin;
use std::task::{Context, Poll};
use surefoot_proto::reason::Reason;

/// Runs a gRPC call while its token is accepted. Connect calls are gRPC calls at this layer.
pub(super) async fn watch(request: Request, next: Next) -> Response<Body> {
    let Some(holder) = request.extensions().get::<Holder>().cloned() else { return next.run(request).await };
    let guard = |body, end| {
        Body::new(Guarded {
            body,
            holder: holder.clone(),
            removed: Box::pin(holder.clone().removed()),
            end,
            is_over: false,
        })
    };
    let request = request.map(|body| guard(body, End::Error));
    let response = next.run(request).await;
    let kind = response.headers().get(header::CONTENT_TYPE);
    match kind.is_some_and(|kind| kind.as_bytes().starts_with(b"application/grpc")) {
        true => response.map(|body| guard(body, End::Trailers)),
        false => response,
    }
}

/// How a body ends when the token is removed.
#[derive(Debug, Clone, Copy)]
enum End {
    /// With an error: a request.
    Error,
    /// With trailers: an answer.
    Trailers,
}

impl End {
    fn frame(self) -> Result<Frame<Bytes>, axum::Error> {
        let status = status::failure(Reason::TokenUnknown, "the token of this call was removed");
        match self {
            Self::Error => Err(axum::Error::new(status)),
            Self::Trailers => {
                let mut trailers = HeaderMap::new();
                status.add_header(&mut trailers).map_err(axum::Error::new)?;
                Ok(Frame::trailers(trailers))
            }
        }
    }
}

/// A body that ends when the token of its call is removed.
struct Guarded {
    body: Body,
    holder: Holder,
    /// Wakes the task once the token is removed.
    removed: Pin<Box<dyn Future<Output = ()> + Send>>,
    end: End,
    is_over: bool,
}

impl Guarded {
    /// Whether the token is removed; if so, the body is over.
    fn is_removed(&mut self, context: &mut Context<'_>) -> bool {
        self.is_over = self.removed.as_mut().poll(context).is_ready() || self.holder.is_removed();
        if self.is_over {
            self.body = Body::empty();
        }
        self.is_over
    }
}

impl HttpBody for Guarded {
    type Data = Bytes;
    type Error = axum::Error;

    fn poll_frame(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
    ) -> Poll<Option<Result<Frame<Bytes>, axum::Error>>> {
        if self.is_over {
            return Poll::Ready(None);
        }
        if self.is_removed(context) {
            return Poll::Ready(Some(self.end.frame()));
        }
        let polled = Pin::new(&mut self.body).poll_frame(context);
        let is_end = match &polled {
            Poll::Ready(Some(frame)) => frame.as_ref().is_ok_and(Frame::is_trailers),
            Poll::Ready(None) => true,
            Poll::Pending => false,
        };
        // The end of the request may have ended the answer with another status since the first look.
        if is_end && self.is_removed(context) {
            return Poll::Ready(Some(self.end.frame()));
        }
        polled
    }

    fn is_end_stream(&self) -> bool {
        self.is_over || self.body.is_end_stream()
    }
}
