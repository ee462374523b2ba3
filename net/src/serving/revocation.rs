//! Ends calls whose token is removed while they run: their requests and their answers break off with UNAUTHENTICATED.

use super::protocol::framed;
use super::tokens::Holder;
use crate::status;
use axum::body::{Body, Bytes, HttpBody};
use axum::extract::Request;
use axum::http::{HeaderMap, Response, header};
use axum::middleware::Next;
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use http_body::Frame;
use std::future::Future;
use std::pin::Pin;
use std::task::{Context, Poll};
use surefoot_proto::reason::Reason;

/// Flag of the last frame of a gRPC-Web answer.
const WEB_TRAILERS: u8 = 0x80;

/// Runs a call of gRPC or gRPC-Web for as long as its token is accepted.
pub(super) async fn watch(request: Request, next: Next) -> Response<Body> {
    let Some(holder) = request.extensions().get::<Holder>().cloned() else { return next.run(request).await };
    let guard =
        |body, end| Body::new(Guarded { body, removed: Box::pin(holder.clone().removed()), end, is_over: false });
    let request = request.map(|body| guard(body, End::Error));
    let response = next.run(request).await;
    let kind = response.headers().get(header::CONTENT_TYPE).map(|kind| kind.as_bytes());
    let end = match kind {
        Some(kind) if kind.starts_with(b"application/grpc-web-text") => End::WebText,
        Some(kind) if kind.starts_with(b"application/grpc-web") => End::Web,
        Some(kind) if kind.starts_with(b"application/grpc") => End::Grpc,
        _ => return response,
    };
    response.map(|body| guard(body, end))
}

/// How a body breaks off.
#[derive(Debug, Clone, Copy)]
enum End {
    /// With an error, as that of a request.
    Error,
    Grpc,
    Web,
    WebText,
}

impl End {
    fn frame(self) -> Result<Frame<Bytes>, axum::Error> {
        let status = status::failure(Reason::TokenUnknown, "the token of this call was removed");
        if matches!(self, Self::Error) {
            return Err(axum::Error::new(status));
        }
        let mut trailers = HeaderMap::new();
        status.add_header(&mut trailers).map_err(axum::Error::new)?;
        Ok(match self {
            Self::Web => Frame::data(web_trailers(&trailers).into()),
            Self::WebText => Frame::data(STANDARD.encode(web_trailers(&trailers)).into()),
            Self::Grpc | Self::Error => Frame::trailers(trailers),
        })
    }
}

/// Trailers as gRPC-Web has them: in a frame of the body.
fn web_trailers(trailers: &HeaderMap) -> Vec<u8> {
    let line = |(name, value): (&axum::http::HeaderName, &axum::http::HeaderValue)| {
        [name.as_str().as_bytes(), b":", value.as_bytes(), b"\r\n"].concat()
    };
    framed(WEB_TRAILERS, &trailers.iter().flat_map(line).collect::<Vec<u8>>())
}

/// A body that breaks off when the token of its call is removed.
struct Guarded {
    body: Body,
    removed: Pin<Box<dyn Future<Output = ()> + Send>>,
    end: End,
    is_over: bool,
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
        if self.removed.as_mut().poll(context).is_ready() {
            self.is_over = true;
            self.body = Body::empty();
            return Poll::Ready(Some(self.end.frame()));
        }
        Pin::new(&mut self.body).poll_frame(context)
    }

    fn is_end_stream(&self) -> bool {
        self.is_over || self.body.is_end_stream()
    }
}
