//! Several replicas of a service: the order in which a client calls them.
//!
//! All calls about one map go to the same replica, which therefore holds the map's graphs in memory: the first in the
//! order of [`ranking`] (rendezvous hashing). Clients with the same list of addresses choose the same replica. When a
//! replica is removed, only its maps move.

use crate::client::{Credentials, Dialer, Link, LinkError};
use axum::body::Bytes;
use http::{Request, Response};
use http_body_util::{BodyExt, Full};
use parking_lot::Mutex;
use prost::encoding::{DecodeContext, decode_key, skip_field, string};
use std::cmp::Reverse;
use std::hash::{BuildHasher, RandomState};
use std::pin::Pin;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, LazyLock};
use std::task::{Context, Poll};
use std::time::{Duration, Instant};
use tonic::body::Body;
use tonic::transport::Error;
use tonic::{Code, Status};
use tower_service::Service;

/// How long a replica that did not answer is tried last: after the first failure, and at most. Each failure doubles it.
const RESTS: [Duration; 2] = [Duration::from_secs(1), Duration::from_secs(30)];
/// Calls that change state, and the number of the field `request_id` in their requests. An interrupted call may have
/// been applied; its id makes a repeat harmless.
const REQUEST_IDS: [(&str, u32); 4] = [
    ("/surefoot.planner.v1.PlannerService/ReportTraversals", 3),
    ("/surefoot.planner.v1.PlannerService/PutLayer", 4),
    ("/surefoot.planner.v1.PlannerService/AppendEdits", 5),
    ("/surefoot.planner.v1.PlannerService/UndoEdits", 5),
];
/// Bytes of a gRPC frame before its message: whether it is compressed, and its length.
const FRAME_HEAD: usize = 5;

/// The order in which the replicas at `addresses` are tried for `key`, such as the hash of a map: indices, the first
/// choice first.
///
/// Replicas are sorted by score, the greatest first: the 64-bit FNV-1a hash of the key, a line feed and the address,
/// scrambled as in the output of SplitMix64.
pub fn ranking<'a>(key: &str, addresses: impl IntoIterator<Item = &'a str>) -> Vec<usize> {
    let mut ranked: Vec<(u64, usize)> =
        addresses.into_iter().enumerate().map(|(idx, address)| (score(key, address), idx)).collect();
    ranked.sort_by_key(|&(score, idx)| (Reverse(score), idx));
    ranked.into_iter().map(|(_, idx)| idx).collect()
}

fn score(key: &str, address: &str) -> u64 {
    let bytes = key.bytes().chain([b'\n']).chain(address.bytes());
    let hash =
        bytes.fold(0xcbf2_9ce4_8422_2325, |hash: u64, byte| (hash ^ u64::from(byte)).wrapping_mul(0x100_0000_01b3));
    let hash = (hash ^ (hash >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let hash = (hash ^ (hash >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    hash ^ (hash >> 31)
}

/// Addresses of the replicas of one service.
#[derive(Debug, Clone)]
pub struct Replicas(Vec<(String, Dialer)>);

impl Replicas {
    /// Prepares connections to all `uris`.
    pub fn dial(credentials: &Credentials, uris: &[String]) -> Result<Self, LinkError> {
        let dialed = uris.iter().map(|uri| Ok((uri.clone(), credentials.dial(uri)?)));
        dialed.collect::<Result<_, LinkError>>().map(Self)
    }

    /// One connection to each replica, made on the first call.
    pub fn connect_lazy(&self) -> ReplicaLinks {
        let line = |(address, dialer): &(String, Dialer)| {
            Arc::new(Line { address: address.clone(), link: dialer.connect_lazy(), resting: Mutex::default() })
        };
        ReplicaLinks(self.0.iter().map(line).collect())
    }
}

/// Connections to all replicas. Clones share them.
#[derive(Debug, Clone)]
pub struct ReplicaLinks(Arc<[Arc<Line>]>);

#[derive(Debug)]
struct Line {
    address: String,
    link: Link,
    /// Until when it is tried last, and the pause after its next failure.
    resting: Mutex<Option<(Instant, Duration)>>,
}

impl Line {
    fn is_resting(&self) -> bool {
        self.resting.lock().is_some_and(|(until, _)| Instant::now() < until)
    }

    fn note(&self, answers: bool) {
        let [first, longest] = RESTS;
        let mut resting = self.resting.lock();
        *resting = match *resting {
            _ if answers => None,
            // Calls that were sent together fail together and count once.
            Some((until, pause)) if Instant::now() < until => Some((until, pause)),
            former => {
                let pause = former.map_or(first, |(_, pause)| pause);
                Some((Instant::now() + pause, (pause * 2).min(longest)))
            }
        };
    }
}

/// A call that waits for its answer. If its caller gives up, this counts as a failure of the replica.
struct Waiting<'a>(&'a Line);

impl Drop for Waiting<'_> {
    fn drop(&mut self) {
        self.0.note(false);
    }
}

impl ReplicaLinks {
    /// The link for calls about `key`.
    pub fn for_key(&self, key: &str) -> ReplicaLink {
        let order = ranking(key, self.0.iter().map(|line| line.address.as_str()));
        ReplicaLink { lines: order.into_iter().map(|idx| self.0[idx].clone()).collect() }
    }
}

/// A link for generated clients. If a replica does not answer, or answers UNAVAILABLE, the call goes to the next
/// replica. A call that changes state gets a `request_id` if it has none, so that replicas with a shared store apply it
/// once. For calls with a single request only.
#[derive(Debug, Clone)]
pub struct ReplicaLink {
    lines: Arc<[Arc<Line>]>,
}

impl ReplicaLink {
    /// Whether no replica has answered its last call, and none is due to be tried again.
    pub fn is_resting(&self) -> bool {
        self.lines.iter().all(|line| line.is_resting())
    }
}

impl Service<Request<Body>> for ReplicaLink {
    type Response = Response<Body>;
    type Error = Error;
    type Future = Pin<Box<dyn Future<Output = Result<Response<Body>, Error>> + Send>>;

    fn poll_ready(&mut self, _: &mut Context<'_>) -> Poll<Result<(), Error>> {
        // Each call waits for the connection that it takes.
        Poll::Ready(Ok(()))
    }

    fn call(&mut self, request: Request<Body>) -> Self::Future {
        let lines = self.lines.clone();
        Box::pin(async move {
            let (head, body) = request.into_parts();
            // The client has already encoded the request, so this neither waits nor fails.
            let body = match body.collect().await {
                Ok(body) => identified(head.uri.path(), body.to_bytes()),
                Err(status) => return Ok(status.into_http()),
            };
            // Replicas that failed recently come last; the sort is stable.
            let mut order: Vec<&Arc<Line>> = lines.iter().collect();
            order.sort_by_key(|line| line.is_resting());
            let mut last = Ok(Status::unavailable("no replica is configured").into_http());
            for line in order {
                let mut request = Request::new(Body::new(Full::new(body.clone())));
                (*request.method_mut(), *request.uri_mut()) = (head.method.clone(), head.uri.clone());
                (*request.version_mut(), *request.headers_mut()) = (head.version, head.headers.clone());
                *request.extensions_mut() = head.extensions.clone();
                let waiting = Waiting(line);
                let answer = send(line.link.clone(), request).await;
                std::mem::forget(waiting);
                let is_refused = answer.as_ref().is_ok_and(is_unavailable);
                line.note(answer.is_ok() && !is_refused);
                if answer.is_ok() && !is_refused {
                    return answer;
                }
                last = answer;
            }
            last
        })
    }
}

async fn send(mut link: Link, request: Request<Body>) -> Result<Response<Body>, Error> {
    std::future::poll_fn(|cx| link.poll_ready(cx)).await?;
    link.call(request).await
}

/// Whether the client should try the next replica, as when this one stops.
fn is_unavailable(response: &Response<Body>) -> bool {
    Status::from_header_map(response.headers()).is_some_and(|status| status.code() == Code::Unavailable)
}

/// Adds a `request_id` to the frame of a call that can have one and has none. Compressed frames are not changed.
fn identified(path: &str, frame: Bytes) -> Bytes {
    let Some((_, field)) = REQUEST_IDS.iter().find(|(call, _)| *call == path) else { return frame };
    match frame.split_at_checked(FRAME_HEAD) {
        Some(([0, ..], message)) if !has_field(message, *field) => {
            let mut message = message.to_vec();
            string::encode(*field, &new_request_id(), &mut message);
            let length = u32::try_from(message.len()).unwrap_or(u32::MAX).to_be_bytes();
            [&[0][..], &length, &message].concat().into()
        }
        _ => frame,
    }
}

/// Whether an encoded message has this field. True for a malformed message, which the service will refuse.
fn has_field(mut message: &[u8], field: u32) -> bool {
    while !message.is_empty() {
        let Ok((number, wire_type)) = decode_key(&mut message) else { return true };
        if number == field || skip_field(wire_type, number, &mut message, DecodeContext::default()).is_err() {
            return true;
        }
    }
    false
}

/// 32 unique hexadecimal digits: hashes of a counter under two random keys of this process.
fn new_request_id() -> String {
    static KEYS: LazyLock<[RandomState; 2]> = LazyLock::new(|| [RandomState::new(), RandomState::new()]);
    static CALLS: AtomicU64 = AtomicU64::new(0);
    let number = CALLS.fetch_add(1, Ordering::Relaxed);
    KEYS.iter().map(|key| format!("{:016x}", key.hash_one(number))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use prost::Message;
    use prost_reflect::{DescriptorPool, DynamicMessage};
    use std::collections::BTreeSet;

    #[test]
    fn calls_of_planners_with_a_request_id_get_one_unless_they_have_it() {
        let pool = DescriptorPool::decode(surefoot_proto::FILE_DESCRIPTOR_SET).unwrap();
        let mut ids = BTreeSet::new();
        for method in pool.get_service_by_name("surefoot.planner.v1.PlannerService").unwrap().methods() {
            let path = format!("/surefoot.planner.v1.PlannerService/{}", method.name());
            let empty = Bytes::from_static(&[0, 0, 0, 0, 0]);
            let frame = identified(&path, empty.clone());
            let Some(field) = method.input().get_field_by_name("request_id") else {
                assert_eq!(frame, empty, "{path}");
                continue;
            };
            let message = DynamicMessage::decode(method.input(), &frame[FRAME_HEAD..]).unwrap();
            let id = message.get_field(&field).as_str().unwrap().to_owned();
            assert_eq!((id.len(), u32::from_be_bytes(frame[1..FRAME_HEAD].try_into().unwrap())), (32, 34), "{path}");
            assert!(ids.insert(id), "{path}");
            assert_eq!(message.encode_to_vec(), frame[FRAME_HEAD..], "nothing else");
            assert_eq!(identified(&path, frame.clone()), frame, "it keeps the id that it has");
        }
        assert_eq!(ids.len(), REQUEST_IDS.len());
    }

    #[test]
    fn keys_spread_evenly_and_stay_when_another_replica_goes() {
        let addresses: Vec<String> = (0..5).map(|idx| format!("http://planner-{idx}:7601")).collect();
        let all = || addresses.iter().map(String::as_str);
        let mut counts = [0; 5];
        for key in 0..5000 {
            let key = format!("{key:064x}");
            let order = ranking(&key, all());
            counts[order[0]] += 1;
            let without_last = ranking(&key, all().take(4));
            assert_eq!(without_last, order.iter().copied().filter(|&idx| idx != 4).collect::<Vec<_>>());
        }
        assert!(counts.iter().all(|count| (900..1100).contains(count)), "{counts:?}");
    }

    #[test]
    fn the_order_is_the_one_that_clients_in_other_languages_compute() {
        let addresses = ["http://a:7601", "http://b:7601", "http://c:7601"];
        let key = "0".repeat(64);
        let scores = addresses.map(|address| score(&key, address));
        assert_eq!(scores, [0xcf7a_707f_f91b_efa4, 0x4d9b_f895_08cd_23bb, 0x063b_8f1b_5132_ab1f]);
        assert_eq!(ranking(&key, addresses), [0, 1, 2]);
    }
}
