//! The Connect protocol (<https://connectrpc.com/docs/protocol>) in front of the gRPC services, for engines and scripts that have
//! HTTP and JSON but no protobuf.
//!
//! A call is translated into a gRPC call of the same service within the process, and its answer is translated back. Unary calls
//! use `application/json` (or `application/proto`), server streams `application/connect+json` (or `+proto`). A server stream
//! that is called with plain `application/json` answers with one JSON document per line (`application/x-ndjson`); if the stream
//! fails, the last line is `{"error": ...}`. Client streams need gRPC.

use super::protocol::{Codec, Connect, END, FRAME, framed};
use crate::status;
use axum::body::{Body, Bytes};
use axum::extract::{Request, State};
use axum::http::{HeaderMap, HeaderValue, Method, Response, StatusCode, Version, header};
use axum::middleware::Next;
use http_body_util::{BodyExt, Limited};
use prost::Message as _;
use prost_reflect::{DescriptorPool, DynamicMessage, MessageDescriptor, MethodDescriptor};
use std::sync::LazyLock;
use std::time::Duration;
use surefoot_proto::reason::Reason;
use tokio::sync::mpsc;
use tokio_stream::wrappers::ReceiverStream;
use tonic::Status;

/// Descriptors of all contracts.
pub(super) static POOL: LazyLock<DescriptorPool> = LazyLock::new(|| {
    DescriptorPool::decode(surefoot_proto::FILE_DESCRIPTOR_SET).expect("the contracts were compiled with this program")
});

/// Answers Connect calls, and passes all other requests on.
pub(super) async fn serve(State(max_bytes): State<usize>, request: Request, next: Next) -> Response<Body> {
    let Some(connect) = Connect::of(&request) else { return next.run(request).await };
    match Call::read(connect, request, max_bytes).await {
        Ok(call) => call.run(next).await,
        Err(status) => connect.refuse(&status),
    }
}

/// A Connect call, translated into a gRPC request.
struct Call {
    connect: Connect,
    method: MethodDescriptor,
    grpc: Request,
    /// Time until the answer must begin.
    deadline: Option<Duration>,
}

impl Call {
    async fn read(connect: Connect, request: Request, max_bytes: usize) -> Result<Self, Status> {
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
        let body = match Limited::new(body, max_bytes).collect().await {
            Ok(body) => body.to_bytes(),
            Err(_) => {
                let message = format!("the request is larger than {max_bytes} bytes, or was cut off");
                return Err(status::failure(Reason::TooLarge, message));
            }
        };
        let body = if connect.is_stream { unframed(&body)? } else { &body[..] };
        let message = match connect.codec {
            Codec::Proto => body.to_vec(),
            Codec::Json => from_json(method.input(), body)?,
        };
        let mut grpc = Request::new(Body::from(framed(0, &message)));
        *grpc.method_mut() = Method::POST;
        *grpc.uri_mut() = parts.uri;
        *grpc.version_mut() = Version::HTTP_2;
        *grpc.extensions_mut() = parts.extensions;
        let headers = grpc.headers_mut();
        headers.insert(header::CONTENT_TYPE, HeaderValue::from_static("application/grpc"));
        headers.insert(header::TE, HeaderValue::from_static("trailers"));
        Ok(Self { connect, method, grpc, deadline: timeout(&parts.headers)? })
    }

    async fn run(self, next: Next) -> Response<Body> {
        let Self { connect, method, grpc, deadline } = self;
        let response = match deadline {
            None => next.run(grpc).await,
            Some(limit) => match tokio::time::timeout(limit, next.run(grpc)).await {
                Ok(response) => response,
                Err(_) => {
                    let message = format!("no answer within {} ms (connect-timeout-ms)", limit.as_millis());
                    return connect.refuse(&status::failure(Reason::DeadlineExceeded, message));
                }
            },
        };
        // An answer without messages has its status in the headers.
        if let Some(status) = failure_in(response.headers()) {
            return connect.refuse(&status);
        }
        let output = Output { connect, message: method.output() };
        if method.is_server_streaming() { stream(output, response) } else { unary(output, response).await }
    }
}

/// Returns the method at a path such as `/surefoot.world.v1.WorldService/CreateWorld`.
fn method_of(path: &str) -> Result<MethodDescriptor, Status> {
    let found = path.trim_start_matches('/').split_once('/').and_then(|(service, method)| {
        let service = POOL.get_service_by_name(service)?;
        service.methods().find(|found| found.name() == method)
    });
    found.ok_or_else(|| status::failure(Reason::UnknownMethod, format!("{path} is not a method of this service")))
}

/// Returns the time that a call may take.
fn timeout(headers: &HeaderMap) -> Result<Option<Duration>, Status> {
    let Some(limit) = headers.get("connect-timeout-ms") else { return Ok(None) };
    let milliseconds = limit.to_str().ok().and_then(|text| text.parse::<u64>().ok());
    let milliseconds = milliseconds.filter(|limit| *limit < 100_000_000).ok_or_else(|| {
        status::failure(Reason::MalformedRequest, "connect-timeout-ms is not a number of milliseconds")
    })?;
    Ok(Some(Duration::from_millis(milliseconds)))
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
fn unframed(body: &[u8]) -> Result<&[u8], Status> {
    let malformed = |message: &str| status::failure(Reason::MalformedRequest, message);
    let (head, message) = body.split_at_checked(FRAME).ok_or_else(|| malformed("the request has no frame"))?;
    if head[0] != 0 {
        return Err(malformed("compressed requests are not supported"));
    }
    let len = u32::from_be_bytes([head[1], head[2], head[3], head[4]]) as usize;
    if message.len() == len { Ok(message) } else { Err(malformed("the request is not exactly one frame")) }
}

/// Returns the status in headers or trailers, if it is a failure.
fn failure_in(headers: &HeaderMap) -> Option<Status> {
    let status = Status::from_header_map(headers)?;
    (status.code() != tonic::Code::Ok).then(|| status::with_reason(status))
}

/// How the messages of an answer are encoded.
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

async fn unary(output: Output, response: Response<Body>) -> Response<Body> {
    let collected = match response.into_body().collect().await {
        Ok(collected) => collected,
        Err(error) => return output.connect.refuse(&status::failure(Reason::Internal, error.to_string())),
    };
    if let Some(status) = collected.trailers().and_then(failure_in) {
        return output.connect.refuse(&status);
    }
    let body = collected.to_bytes();
    match output.encode(body.get(FRAME..).unwrap_or_default()) {
        Ok(message) => answer(output.connect.content_type(), Body::from(message)),
        Err(status) => output.connect.refuse(&status),
    }
}

/// Streams the messages of a gRPC answer as they arrive.
fn stream(output: Output, response: Response<Body>) -> Response<Body> {
    let content_type = if output.connect.is_stream { output.connect.content_type() } else { "application/x-ndjson" };
    let (queue, items) = mpsc::channel::<Result<Bytes, std::convert::Infallible>>(1);
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
            let items = match whole_items(&output, &mut pending) {
                Ok(items) => items,
                Err(status) => break Some(status),
            };
            if !items.is_empty() && queue.send(Ok(items.into())).await.is_err() {
                return;
            }
        };
        // A client that has disconnected needs no end.
        let _ = queue.send(Ok(output.end(end.as_ref()).into())).await;
    });
    answer(content_type, Body::from_stream(ReceiverStream::new(items)))
}

/// Removes the complete gRPC frames from `pending`, and encodes their messages.
fn whole_items(output: &Output, pending: &mut Vec<u8>) -> Result<Vec<u8>, Status> {
    let (mut items, mut at) = (Vec::new(), 0);
    while let Some([_, len @ ..]) = pending[at..].first_chunk::<FRAME>() {
        let end = at + FRAME + u32::from_be_bytes(*len) as usize;
        let Some(message) = pending.get(at + FRAME..end) else { break };
        items.extend(output.item(message)?);
        at = end;
    }
    pending.drain(..at);
    Ok(items)
}

fn answer(content_type: &'static str, body: Body) -> Response<Body> {
    let mut response = Response::new(body);
    *response.status_mut() = StatusCode::OK;
    response.headers_mut().insert(header::CONTENT_TYPE, HeaderValue::from_static(content_type));
    response
}
