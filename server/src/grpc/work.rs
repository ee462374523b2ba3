//! The stream of a worker: its hello, its answers, and how it ends.

use super::{Call, Reply, WorldApi};
use crate::ids::WorldId;
use crate::messages::{Goodbye, Hello, ToWorker};
use crate::registry::Joined;
use crate::wire::worker::{self as convert_worker, to_worker};
use crate::worlds::Worlds;
use std::time::Duration;
use surefoot_net::status;
use surefoot_proto::reason::Reason;
use surefoot_proto::world::v1 as wire;
use tokio::sync::mpsc;
use tokio_stream::StreamExt;
use tokio_stream::wrappers::ReceiverStream;
use tonic::codegen::BoxStream;
use tonic::{Code, Status, Streaming};
use tonic_types::StatusExt;
use tracing::warn;

/// Most messages waiting for one worker. Further observations are dropped, and their decisions count as missed.
const WORKER_QUEUE: usize = 256;
/// Longest time until the hello of a new worker.
const HELLO_LIMIT: Duration = Duration::from_secs(5);

async fn read_hello(requests: &mut Streaming<wire::WorkRequest>) -> Result<Hello, Status> {
    let first = tokio::time::timeout(HELLO_LIMIT, requests.next())
        .await
        .map_err(|_| status::failure(Reason::DeadlineExceeded, "no hello within five seconds"))?;
    convert_worker::hello(first.transpose()?)
}

/// Lets a worker join, and reads its answers until its stream ends.
pub async fn work(
    api: &WorldApi,
    (_, mut requests): Call<Streaming<wire::WorkRequest>>,
) -> Reply<BoxStream<wire::WorkResponse>> {
    let hello = read_hello(&mut requests).await?;
    let (queue, messages) = mpsc::channel(WORKER_QUEUE);
    let joined = api.worlds.join(hello, queue.clone());
    tokio::spawn(read_answers(api.worlds.clone(), joined, requests, queue));
    Ok(Box::pin(ReceiverStream::new(messages).map(to_worker)))
}

/// Reads a worker's stream until it ends, fails, or the server shuts down.
async fn read_answers(
    worlds: Worlds,
    Joined { id: worker, cut }: Joined,
    mut requests: Streaming<wire::WorkRequest>,
    queue: mpsc::Sender<ToWorker>,
) {
    let shutdown = worlds.shutdown().wait();
    tokio::pin!(shutdown);
    let end = loop {
        let request = tokio::select! {
            request = requests.next() => request,
            () = &mut shutdown => break Some(Goodbye::ShuttingDown),
            () = queue.closed() => break None,
            () = cut.notified() => break Some(Goodbye::NotReading),
        };
        let result = match request {
            None | Some(Err(_)) => break None,
            Some(Ok(wire::WorkRequest { message: Some(wire::work_request::Message::Actions(batch)) })) => {
                let world = WorldId(batch.world_id);
                let answer = convert_worker::answer(batch).map_err(|status| bad_answer(&status));
                answer.map(|answer| worlds.answer(worker, world, answer))
            }
            Some(Ok(wire::WorkRequest { message: Some(wire::work_request::Message::Capacity(capacity)) })) => {
                worlds.set_capacity(worker, capacity);
                Ok(())
            }
            Some(Ok(_)) => Err(Goodbye::Unexpected),
        };
        if let Err(goodbye) = result {
            warn!(worker = worker.0, %goodbye, "worker disconnected");
            break Some(goodbye);
        }
    };
    if let Some(goodbye) = end {
        // If the worker does not read, its stream ends without the reason.
        let _ = queue.try_send(ToWorker::Goodbye(goodbye));
    }
    worlds.leave(worker);
}

fn bad_answer(status: &Status) -> Goodbye {
    debug_assert_eq!(status.code(), Code::InvalidArgument);
    let field = status.get_details_bad_request().and_then(|details| details.field_violations.into_iter().next());
    Goodbye::BadAnswer(field.map_or_else(String::new, |field| field.field), status.message().to_owned())
}
