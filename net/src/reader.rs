//! A stream to one reader: at most one message waits for it, and a reader that reads nothing at all is cut off.

use crate::status;
use std::pin::Pin;
use std::sync::{Arc, OnceLock};
use std::task::{Context, Poll, ready};
use std::time::Duration;
use surefoot_proto::reason::Reason;
use tokio::sync::mpsc;
use tokio_stream::Stream;
use tonic::Status;

/// For how long a reader may read nothing, unless a service is configured otherwise.
pub const DEFAULT_PATIENCE: Duration = Duration::from_secs(5);
/// Most messages that wait for one reader.
const QUEUE: usize = 1;

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

/// The sending side of a [`ReaderStream`]. Dropping it ends the stream.
#[derive(Debug)]
pub struct Reader<T> {
    queue: mpsc::Sender<T>,
    end: Arc<OnceLock<Status>>,
    patience: Duration,
}

impl<T> Reader<T> {
    /// Both sides of a stream to a reader that is cut off once it has read nothing for `patience`.
    pub fn new(patience: Duration) -> (Self, ReaderStream<T>) {
        let (queue, messages) = mpsc::channel(QUEUE);
        let end = Arc::new(OnceLock::new());
        (Self { queue, end: end.clone(), patience }, ReaderStream { messages, end, is_over: false })
    }

    /// Resolves when the reader has left.
    pub async fn closed(&self) {
        self.queue.closed().await;
    }

    /// Ends the stream with `status`.
    pub fn close(self, status: Status) {
        // The status is not set yet, because closing consumes the reader.
        let _ = self.end.set(status);
    }

    /// Sends a message, waiting for a slow reader for at most its patience; returns `None` if the stream is over.
    pub async fn send(self, message: T) -> Option<Self> {
        match tokio::time::timeout(self.patience, self.queue.send(message)).await {
            Ok(Ok(())) => Some(self),
            Ok(Err(_)) => None,
            Err(_) => {
                let seconds = self.patience.as_secs_f32();
                let message = format!("nothing was read for {seconds} s: make the call again");
                self.close(status::failure(Reason::ReaderTooSlow, message));
                None
            }
        }
    }
}
