//! A stream to one reader: at most one message waits for it, and a reader that reads nothing at all is cut off.

use crate::serving::{Shutdown, shutting_down};
use crate::status;
use std::future::Future;
use std::pin::Pin;
use std::sync::{Arc, OnceLock};
use std::task::{Context, Poll, ready};
use std::time::Duration;
use surefoot_proto::reason::Reason;
use tokio::sync::mpsc;
use tokio_stream::Stream;
use tonic::Status;

/// How long a reader may read nothing, unless a service is configured otherwise.
pub const DEFAULT_PATIENCE: Duration = Duration::from_secs(5);
/// Most messages that wait for one reader.
const QUEUE: usize = 1;

/// Where the messages of a stream come from.
pub trait Source: Send + 'static {
    /// A message of the stream.
    type Message: Send + 'static;

    /// Returns the next messages, possibly none, or the status that ends the stream. `None` ends it without a failure.
    fn next(&mut self) -> impl Future<Output = Option<Result<Vec<Self::Message>, Status>>> + Send;
}

/// A stream to one reader, which can end with a status.
#[derive(Debug)]
pub struct ReaderStream<T> {
    messages: mpsc::Receiver<T>,
    end: Arc<OnceLock<Status>>,
    is_over: bool,
}

impl<T> Stream for ReaderStream<T> {
    type Item = Result<T, Status>;

    fn poll_next(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<Option<Self::Item>> {
        if self.is_over {
            return Poll::Ready(None);
        }
        if let Some(message) = ready!(self.messages.poll_recv(context)) {
            return Poll::Ready(Some(Ok(message)));
        }
        self.is_over = true;
        Poll::Ready(self.end.get().cloned().map(Err))
    }
}

/// Streams the messages of `source`. The stream ends with the source, when the reader leaves, when the reader has read
/// nothing for `patience`, or at the `shutdown`, if there is one.
pub fn stream<S: Source>(source: S, patience: Duration, shutdown: Option<&Shutdown>) -> ReaderStream<S::Message> {
    let stopping = shutdown.map(Shutdown::wait);
    let stopping = async move {
        match stopping {
            Some(stopping) => stopping.await,
            None => std::future::pending().await,
        }
    };
    let (queue, messages) = mpsc::channel(QUEUE);
    let end = Arc::new(OnceLock::new());
    let stream = ReaderStream { messages, end: end.clone(), is_over: false };
    tokio::spawn(async move {
        if let Err(status) = send_all(source, &queue, patience, stopping).await {
            // Nothing else sets the status.
            let _ = end.set(status);
        }
    });
    stream
}

async fn send_all<S: Source>(
    mut source: S,
    queue: &mpsc::Sender<S::Message>,
    patience: Duration,
    stopping: impl Future<Output = ()>,
) -> Result<(), Status> {
    tokio::pin!(stopping);
    loop {
        let next = tokio::select! {
            next = source.next() => next.transpose()?,
            () = &mut stopping => return Err(shutting_down()),
            () = queue.closed() => return Ok(()),
        };
        let Some(messages) = next else { return Ok(()) };
        for message in messages {
            match tokio::time::timeout(patience, queue.send(message)).await {
                Ok(Ok(())) => {}
                Ok(Err(_)) => return Ok(()),
                Err(_) => {
                    let message = format!("nothing was read for {} s: make the call again", patience.as_secs_f32());
                    return Err(status::failure(Reason::ReaderTooSlow, message));
                }
            }
        }
    }
}
