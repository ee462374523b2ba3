//! The Connect protocol (<https://connectrpc.com/docs/protocol>) in front of the gRPC services: for browsers, and for
//! engines and scripts that have HTTP and JSON but no protobuf.
//!
//! A call is translated into a gRPC call of the same service within the process, and its answer is translated back.
//! Unary calls use `application/json` (or `application/proto`), server streams `application/connect+json` (or
//! `+proto`). A server stream that is called with plain `application/json` answers with one JSON document per line
//! (`application/x-ndjson`); if the stream fails, the last line is `{"error": ...}`. Client streams need gRPC.

use super::limits::Limits;
use super::metered::SMALL_BYTES;
use super::methods::method_of;
use super::protocol::{Codec, Connect, END, FRAME, framed};
use crate::memory::MemoryBudget;
use crate::serving::Caller;
use crate::status;
use axum::body::{Body, Bytes};
use axum::extract::{Request, State};
use axum::http::{HeaderMap, HeaderValue, Method, Response, StatusCode, Version, header};
use axum::middleware::Next;
use http_body_util::{BodyExt, Limited};
use prost::Message as _;
use prost_reflect::{DynamicMessage, MessageDescriptor, MethodDescriptor};
use std::sync::Arc;
use surefoot_proto::reason::Reason;
use tokio::sync::{Semaphore, mpsc};
use tokio_stream::wrappers::ReceiverStream;
use tonic::Status;

/// The service whose requests contain levels.
const MAPS: &str = "surefoot.world.v1.MapService";
/// Longest JSON, as a multiple of the length of its message: numbers and base64 take more bytes in JSON.
const JSON_FACTOR: usize = 4;
/// The same for a message that is mostly base64.
const BASE64_FACTOR: usize = 2;
/// Large messages that are translated at the same time.
const TRANSLATED_AT_A_TIME: usize = 2;

/// Translates calls of the Connect protocol.
pub(super) struct Translator {
    limits: Limits,
    /// Budget for the translation of large requests.
    memory: MemoryBudget,
    turns: Semaphore,
}

impl Translator {
    pub fn new(limits: Limits, memory: MemoryBudget) -> Self {
        Self { limits, memory, turns: Semaphore::new(TRANSLATED_AT_A_TIME) }
    }

    /// Most bytes of the body of a call.
    fn max_bytes(&self, method: &MethodDescriptor) -> usize {
        match method.parent_service().full_name() {
            MAPS => BASE64_FACTOR * self.limits.max_import_bytes,
            _ => JSON_FACTOR * self.limits.max_message_bytes,
        }
    }

    /// Runs `work` on a message of `bytes` bytes: at once if it is small, otherwise on a blocking thread, when its turn
    /// comes.
    async fn run<T: Send + 'static>(
        &self,
        bytes: usize,
        work: impl FnOnce() -> Result<T, Status> + Send + 'static,
    ) -> Result<T, Status> {
        if bytes <= SMALL_BYTES {
            return work();
        }
        // Never closed.
        let _turn = self.turns.acquire().await.ok();
        let lost = |error| status::failure(Reason::Internal, format!("the message cannot be translated: {error}"));
        tokio::task::spawn_blocking(work).await.map_err(lost)?
    }

    /// Translates the body of a request into a message.
    async fn message(
        &self,
        call: Connect,
        method: &MethodDescriptor,
        body: Bytes,
        client: &str,
    ) -> Result<Vec<u8>, Status> {
        let body = if call.is_stream { unframed(&body)? } else { body };
        if call.codec == Codec::Proto {
            return Ok(body.into());
        }
        let memory = match body.len() {
            0..=SMALL_BYTES => None,
            _ => Some(self.memory.reserve(client, parsed_bytes(&body))?),
        };
        let input = method.input();
        self.run(body.len(), move || {
            // The caller may disconnect; memory is released when the work is done.
            let _memory = memory;
            from_json(input, &body)
        })
        .await
    }
}

/// Upper bound of the bytes of parsed JSON: a constant for each object and each value, and twice the text.
fn parsed_bytes(json: &[u8]) -> u64 {
    const OBJECT_BYTES: u64 = 1024;
    const VALUE_BYTES: u64 = 128;
    let (mut bytes, mut is_text, mut is_escaped) = (2 * json.len() as u64, false, false);
    for byte in json {
        match byte {
            _ if is_escaped => is_escaped = false,
            b'\\' => is_escaped = is_text,
            b'"' => is_text = !is_text,
            b'{' if !is_text => bytes += OBJECT_BYTES,
            b',' | b'[' if !is_text => bytes += VALUE_BYTES,
            _ => {}
        }
    }
    bytes
}

/// Answers Connect calls, and passes all other requests on.
pub(super) async fn serve(State(by): State<Arc<Translator>>, request: Request, next: Next) -> Response<Body> {
    let Some(connect) = Connect::of(&request) else {
        return if is_of_unknown_type(&request) { unknown_type(&request) } else { next.run(request).await };
    };
    match Call::read(connect, request, &by).await {
        Ok(call) => call.run(next, by).await,
        Err(status) => connect.refuse(&status),
    }
}

/// Whether a request calls a method with a content type that is neither Connect's nor gRPC's.
fn is_of_unknown_type(request: &Request) -> bool {
    let kind = request.headers().get(header::CONTENT_TYPE).map(HeaderValue::as_bytes).unwrap_or_default();
    request.method() == Method::POST
        && !kind.starts_with(b"application/grpc")
        && method_of(request.uri().path()).is_ok()
}

/// Refuses a request as Connect specifies, with the types that can be sent.
fn unknown_type(request: &Request) -> Response<Body> {
    let kind = request.headers().get(header::CONTENT_TYPE).and_then(|kind| kind.to_str().ok());
    let sent = kind.map_or("no content type".to_owned(), |kind| format!("the content type {kind}"));
    let message = format!("the request has {sent}: send the header `Content-Type: application/json`");
    let connect = Connect { codec: Codec::Json, is_stream: false };
    let mut response = connect.refuse(&status::failure(Reason::MalformedRequest, message));
    *response.status_mut() = StatusCode::UNSUPPORTED_MEDIA_TYPE;
    let types = format!("{}, application/grpc", Connect::ALL.map(Connect::content_type).join(", "));
    response.headers_mut().insert("accept-post", HeaderValue::try_from(types).expect("content types are plain text"));
    response
}

/// A Connect call, translated into a gRPC request.
struct Call {
    connect: Connect,
    method: MethodDescriptor,
    grpc: Request,
}

impl Call {
    async fn read(connect: Connect, request: Request, by: &Translator) -> Result<Self, Status> {
        let method = method_of(request.uri().path())?;
        let refuse = |message: String| Err(status::failure(Reason::MalformedRequest, message));
        if method.is_client_streaming() {
            let message = format!("{} takes a stream of requests: call it with gRPC", method.full_name());
            return Err(status::failure(Reason::UnknownMethod, message));
        }
        match (connect.is_stream, method.is_server_streaming()) {
            (true, false) => return refuse(format!("{} is not a stream: send application/json", method.full_name())),
            (false, true) if connect.codec == Codec::Proto => {
                return refuse(format!("{} is a stream: send application/connect+proto", method.full_name()));
            }
            _ => {}
        }
        let (parts, body) = request.into_parts();
        let body = collect(body, by.max_bytes(&method)).await?;
        let client = parts.extensions.get::<Caller>().map_or("unknown", |caller| &caller.name);
        let message = by.message(connect, &method, body, client).await?;
        let mut grpc = Request::new(Body::from(framed(0, &message)));
        *grpc.method_mut() = Method::POST;
        *grpc.uri_mut() = parts.uri;
        *grpc.version_mut() = Version::HTTP_2;
        *grpc.extensions_mut() = parts.extensions;
        let headers = grpc.headers_mut();
        headers.insert(header::CONTENT_TYPE, HeaderValue::from_static("application/grpc"));
        headers.insert(header::TE, HeaderValue::from_static("trailers"));
        Ok(Self { connect, method, grpc })
    }

    async fn run(self, next: Next, by: Arc<Translator>) -> Response<Body> {
        let Self { connect, method, grpc } = self;
        let response = next.run(grpc).await;
        // An answer without messages has its status in the headers.
        if let Some(status) = failure_in(response.headers()) {
            return connect.refuse(&status);
        }
        let output = Output { connect, message: method.output() };
        if method.is_server_streaming() { stream(output, by, response) } else { unary(output, &by, response).await }
    }
}

/// Reads a body of at most `max_bytes` bytes.
async fn collect(body: Body, max_bytes: usize) -> Result<Bytes, Status> {
    match Limited::new(body, max_bytes).collect().await {
        Ok(body) => Ok(body.to_bytes()),
        // The request ended with a status of its own, such as for a lack of memory.
        Err(error) => Err(Status::try_from_error(error).map(status::with_reason).unwrap_or_else(|_| {
            let message = format!("the request is larger than {max_bytes} bytes, or was cut off");
            status::failure(Reason::TooLarge, message)
        })),
    }
}

fn from_json(descriptor: MessageDescriptor, body: &[u8]) -> Result<Vec<u8>, Status> {
    let body = if body.trim_ascii().is_empty() { b"{}" } else { body };
    let malformed = |error: serde_json::Error| {
        status::failure(Reason::MalformedRequest, format!("the request is not a {}: {error}", descriptor.name()))
    };
    let mut json = serde_json::Deserializer::from_slice(body);
    let message = DynamicMessage::deserialize(descriptor.clone(), &mut json).map_err(malformed)?;
    json.end().map_err(malformed)?;
    Ok(message.encode_to_vec())
}

/// Returns the message in the only frame of a request.
fn unframed(body: &Bytes) -> Result<Bytes, Status> {
    let malformed = |message: &str| status::failure(Reason::MalformedRequest, message);
    let (head, message) = body.split_at_checked(FRAME).ok_or_else(|| malformed("the request has no frame"))?;
    if head[0] != 0 {
        return Err(malformed("compressed requests are not supported"));
    }
    let len = u32::from_be_bytes([head[1], head[2], head[3], head[4]]) as usize;
    if message.len() == len {
        Ok(body.slice_ref(message))
    } else {
        Err(malformed("the request is not exactly one frame"))
    }
}

/// The status in headers or trailers, if it is a failure.
fn failure_in(headers: &HeaderMap) -> Option<Status> {
    let status = Status::from_header_map(headers)?;
    (status.code() != tonic::Code::Ok).then(|| status::with_reason(status))
}

/// How the messages of an answer are encoded.
#[derive(Clone)]
struct Output {
    connect: Connect,
    message: MessageDescriptor,
}

impl Output {
    fn encode(&self, message: &[u8]) -> Result<Vec<u8>, Status> {
        if self.connect.codec == Codec::Proto {
            return Ok(message.to_vec());
        }
        let defect = |error: &dyn std::fmt::Display| status::failure(Reason::Internal, error.to_string());
        let message = DynamicMessage::decode(self.message.clone(), message).map_err(|error| defect(&error))?;
        serde_json::to_vec(&message).map_err(|error| defect(&error))
    }

    /// Encodes a message of a stream.
    fn item(&self, message: &[u8]) -> Result<Vec<u8>, Status> {
        let mut bytes = self.encode(message)?;
        if self.connect.is_stream {
            return Ok(framed(0, &bytes));
        }
        bytes.push(b'\n');
        Ok(bytes)
    }

    /// Encodes the end of a stream; a stream of lines that succeeded has no last line.
    fn end(&self, status: Option<&Status>) -> Vec<u8> {
        let end = match status {
            Some(status) => serde_json::json!({ "error": Connect::error(status) }),
            None if self.connect.is_stream => serde_json::json!({}),
            None => return Vec::new(),
        };
        let mut bytes = serde_json::to_vec(&end).expect("plain data");
        if self.connect.is_stream {
            return framed(END, &bytes);
        }
        bytes.push(b'\n');
        bytes
    }
}

async fn unary(output: Output, by: &Translator, response: Response<Body>) -> Response<Body> {
    let collected = match response.into_body().collect().await {
        Ok(collected) => collected,
        Err(error) => return output.connect.refuse(&status::failure(Reason::Internal, error.to_string())),
    };
    if let Some(status) = collected.trailers().and_then(failure_in) {
        return output.connect.refuse(&status);
    }
    let body = collected.to_bytes();
    let connect = output.connect;
    match by.run(body.len(), move || output.encode(body.get(FRAME..).unwrap_or_default())).await {
        Ok(message) => answer(connect.content_type(), Body::from(message)),
        Err(status) => connect.refuse(&status),
    }
}

/// Streams the messages of a gRPC answer as they arrive.
fn stream(output: Output, by: Arc<Translator>, response: Response<Body>) -> Response<Body> {
    let content_type = if output.connect.is_stream { output.connect.content_type() } else { "application/x-ndjson" };
    let (queue, answers) = mpsc::channel::<Result<Bytes, std::convert::Infallible>>(1);
    let mut body = response.into_body();
    tokio::spawn(async move {
        let mut pending = Vec::new();
        let end = loop {
            let frame = tokio::select! {
                frame = body.frame() => frame,
                () = queue.closed() => return,
            };
            let frame = match frame {
                None => break None,
                Some(Err(error)) => break Some(status::failure(Reason::Internal, error.to_string())),
                Some(Ok(frame)) => frame,
            };
            match frame.into_data() {
                Ok(data) => pending.extend_from_slice(&data),
                Err(frame) => break frame.trailers_ref().and_then(failure_in),
            }
            let whole = whole_bytes(&pending);
            if whole == 0 {
                continue;
            }
            let (output, messages) = (output.clone(), pending.drain(..whole).collect::<Vec<u8>>());
            let items = match by.run(whole, move || items(&output, &messages)).await {
                Ok(items) => items,
                Err(status) => break Some(status),
            };
            if queue.send(Ok(items.into())).await.is_err() {
                return;
            }
        };
        // A client that has disconnected needs no end.
        let _ = queue.send(Ok(output.end(end.as_ref()).into())).await;
    });
    answer(content_type, Body::from_stream(ReceiverStream::new(answers)))
}

/// Length of the first gRPC frame, its prefix included; `None` if it is not complete.
fn frame_bytes(frames: &[u8]) -> Option<usize> {
    let [_, len @ ..] = frames.first_chunk::<FRAME>()?;
    let end = FRAME + u32::from_be_bytes(*len) as usize;
    (end <= frames.len()).then_some(end)
}

/// Length of the complete gRPC frames.
fn whole_bytes(frames: &[u8]) -> usize {
    let mut at = 0;
    while let Some(len) = frame_bytes(&frames[at..]) {
        at += len;
    }
    at
}

/// Encodes the messages of complete gRPC frames.
fn items(output: &Output, frames: &[u8]) -> Result<Vec<u8>, Status> {
    let (mut items, mut rest) = (Vec::new(), frames);
    while let Some(len) = frame_bytes(rest) {
        items.extend(output.item(&rest[FRAME..len])?);
        rest = &rest[len..];
    }
    Ok(items)
}

fn answer(content_type: &'static str, body: Body) -> Response<Body> {
    let mut response = Response::new(body);
    *response.status_mut() = StatusCode::OK;
    response.headers_mut().insert(header::CONTENT_TYPE, HeaderValue::from_static(content_type));
    response
}
