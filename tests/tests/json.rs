//! Plain HTTP with JSON, as scripts and engines without protobuf use it.

use e2e::{LIMIT, Running, get, start_server, start_server_at};
use prost::Message;
use serde_json::{Value, json};
use surefoot_net::serving::tokens::Tokens;
use surefoot_net::serving::{EndpointConfig, Security};
use surefoot_proto::reason::Reason;
use surefoot_proto::world::v1 as wire;
use surefoot_server::ServerConfig;
use tokio::io::{AsyncBufReadExt, AsyncReadExt, AsyncWriteExt, BufReader};
use tokio::net::TcpStream;
use tokio::net::tcp::OwnedReadHalf;

const WORLD: &str = "/surefoot.world.v1.WorldService";

/// A response whose body is read as it arrives.
struct Answer {
    status: u16,
    content_type: String,
    is_chunked: bool,
    body: BufReader<OwnedReadHalf>,
}

impl Answer {
    async fn into_bytes(mut self) -> Vec<u8> {
        let mut all = Vec::new();
        if self.is_chunked {
            while let Some(chunk) = self.chunk().await {
                all.extend(chunk);
            }
        } else {
            self.body.read_to_end(&mut all).await.unwrap();
        }
        all
    }

    async fn into_json(self) -> (u16, Value) {
        assert_eq!(self.content_type, "application/json");
        let status = self.status;
        (status, serde_json::from_slice(&self.into_bytes().await).unwrap())
    }

    async fn chunk(&mut self) -> Option<Vec<u8>> {
        let mut line = String::new();
        self.body.read_line(&mut line).await.unwrap();
        let len = usize::from_str_radix(line.trim(), 16).unwrap();
        let mut chunk = vec![0; len + 2];
        self.body.read_exact(&mut chunk).await.unwrap();
        chunk.truncate(len);
        (len > 0).then_some(chunk)
    }

    /// The next document of a stream of JSON lines.
    async fn line(&mut self, pending: &mut Vec<u8>) -> Option<Value> {
        loop {
            if let Some(end) = pending.iter().position(|byte| *byte == b'\n') {
                let line: Vec<u8> = pending.drain(..=end).collect();
                return Some(serde_json::from_slice(&line).unwrap());
            }
            let chunk = tokio::time::timeout(LIMIT, self.chunk()).await.expect("the stream goes on")?;
            pending.extend(chunk);
        }
    }
}

async fn post(server: &Running, path: &str, headers: &str, body: &[u8]) -> Answer {
    let (answers, mut socket) = TcpStream::connect(server.address()).await.unwrap().into_split();
    let head = format!(
        "POST {path} HTTP/1.1\r\nHost: {}\r\nConnection: close\r\n{headers}Content-Length: {}\r\n\r\n",
        server.address(),
        body.len()
    );
    let request = [head.as_bytes(), body].concat();
    tokio::spawn(async move {
        // What is too large is refused before it is read, so that this may fail.
        let _ = socket.write_all(&request).await;
        std::future::pending::<()>().await;
    });
    let body = BufReader::new(answers);
    let mut answer = Answer { status: 0, content_type: String::new(), is_chunked: false, body };
    loop {
        let mut line = String::new();
        answer.body.read_line(&mut line).await.unwrap();
        let line = line.trim_end();
        if line.is_empty() {
            return answer;
        } else if let Some(status) = line.strip_prefix("HTTP/1.1 ") {
            answer.status = status[..3].parse().unwrap();
        } else if let Some(kind) = line.strip_prefix("content-type: ") {
            answer.content_type = kind.to_owned();
        } else if line == "transfer-encoding: chunked" {
            answer.is_chunked = true;
        }
    }
}

/// Makes a unary call with JSON; returns the HTTP status and the body.
async fn call(server: &Running, method: &str, body: Value) -> (u16, Value) {
    let body = body.to_string();
    post(server, method, "Content-Type: application/json\r\n", body.as_bytes()).await.into_json().await
}

/// The `reason` in the details of an error.
fn reason(error: &Value) -> &str {
    let details = error["details"].as_array().expect("an error has details");
    let info = details.iter().find(|detail| detail["type"] == "google.rpc.ErrorInfo").expect("an error has a reason");
    assert_eq!(info["debug"]["domain"], "surefoot");
    info["debug"]["reason"].as_str().unwrap()
}

#[tokio::test(flavor = "multi_thread")]
async fn a_game_without_protobuf_makes_a_world_and_follows_its_events() {
    let server = start_server(ServerConfig::default());
    let map = json!({"seed": 50, "size": {"width": 100, "height": 80, "depth": 100}});
    let (status, made) = call(&server, &format!("{WORLD}/CreateWorld"), json!({ "map": map })).await;
    assert_eq!((status, &made["world"]["mode"]), (200, &json!("TIME_MODE_REALTIME")));
    let world_id = &made["world"]["worldId"];
    let (_, ground) =
        call(&server, &format!("{WORLD}/SampleGround"), json!({ "worldId": world_id, "count": 2, "seed": "7" })).await;
    let request = json!({ "worldId": world_id, "rateHz": 20 }).to_string();
    let kind = "Content-Type: application/json; charset=utf-8\r\n";
    let mut events =
        post(&server, &format!("{WORLD}/WatchEvents"), kind, json!({ "worldId": world_id }).to_string().as_bytes())
            .await;
    assert_eq!((events.status, events.content_type.as_str()), (200, "application/x-ndjson"));
    let mut pending = Vec::new();
    let begin = events.line(&mut pending).await.unwrap();
    assert!(begin["cursor"]["epoch"].is_string() && begin["serverTime"].is_string(), "{begin}");
    let spawn = json!({ "worldId": world_id, "spawns": [{ "position": ground["points"][0] }] });
    let (_, spawned) = call(&server, &format!("{WORLD}/BatchSpawnNpcs"), spawn).await;
    let npc_id = &spawned["results"][0]["npcId"];
    let event = events.line(&mut pending).await.unwrap();
    assert_eq!(
        (&event["events"][0]["npcId"], &event["events"][0]["spawned"]["position"]),
        (npc_id, &ground["points"][0])
    );

    // A stream by the Connect protocol, in frames with a length prefix.
    let framed = [&[0][..], &(request.len() as u32).to_be_bytes(), request.as_bytes()].concat();
    let mut frames =
        post(&server, &format!("{WORLD}/WatchWorld"), "Content-Type: application/connect+json\r\n", &framed).await;
    assert_eq!((frames.status, frames.content_type.as_str()), (200, "application/connect+json"));
    let first = frames.chunk().await.unwrap();
    let snapshot: Value = serde_json::from_slice(&first[5..]).unwrap();
    assert_eq!((first[0], &snapshot["npcs"][0]["npcId"]), (0, npc_id));

    let (status, gone) = call(&server, &format!("{WORLD}/DropWorld"), json!({ "worldId": world_id })).await;
    assert_eq!((status, gone), (200, json!({})));
    let end = loop {
        let line = events.line(&mut pending).await.unwrap();
        if line["error"].is_object() {
            break line["error"].clone();
        }
    };
    assert_eq!((end["code"].as_str().unwrap(), reason(&end)), ("not_found", "WORLD_NOT_FOUND"));
    assert!(events.line(&mut pending).await.is_none(), "nothing comes after the end");
    let rest = frames.into_bytes().await;
    let last = rest.windows(2).rposition(|pair| pair == [2, 0]).expect("a last frame");
    let end: Value = serde_json::from_slice(&rest[last + 5..]).unwrap();
    assert_eq!(reason(&end["error"]), "WORLD_NOT_FOUND");
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_call_of_an_unknown_content_type_names_the_header_to_send() {
    let server = start_server(ServerConfig::default());
    for headers in ["", "Content-Type: application/x-www-form-urlencoded\r\n"] {
        let answer = post(&server, &format!("{WORLD}/ListWorlds"), headers, b"{}").await;
        let (status, error) = answer.into_json().await;
        assert_eq!((status, reason(&error)), (415, "MALFORMED_REQUEST"), "{headers}");
        assert!(error["message"].as_str().unwrap().contains("Content-Type: application/json"), "{error}");
    }
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn what_cannot_be_understood_is_refused_in_json_with_a_reason() {
    let server = start_server(ServerConfig::default());
    let get = format!("{WORLD}/GetNpc");
    for (method, body, status, code, expected, words) in [
        (get.as_str(), r#"{"npcId": 7}"#, 404, "not_found", Reason::NpcNotFound, "npc 7"),
        (&get, r#"{"npc": 7}"#, 400, "invalid_argument", Reason::MalformedRequest, "npc"),
        (&get, r#"{"npcId": "seven"}"#, 400, "invalid_argument", Reason::MalformedRequest, "digit"),
        (&get, r#"{"npcId": 7"#, 400, "invalid_argument", Reason::MalformedRequest, "EOF"),
        (&get, "\u{0}", 400, "invalid_argument", Reason::MalformedRequest, "GetNpcRequest"),
        (&format!("{WORLD}/GetNobody"), "{}", 501, "unimplemented", Reason::UnknownMethod, "GetNobody"),
        ("/nothing", "{}", 501, "unimplemented", Reason::UnknownMethod, "/nothing"),
        (&format!("{WORLD}/Work"), "{}", 501, "unimplemented", Reason::UnknownMethod, "gRPC"),
        (&format!("{WORLD}/CreateWorld"), "", 400, "invalid_argument", Reason::InvalidField, "map is missing"),
        (&format!("{WORLD}/WatchWorld"), r#"{"worldId": 7}"#, 404, "not_found", Reason::WorldNotFound, "world 7"),
    ] {
        let answer = post(&server, method, "Content-Type: application/json\r\n", body.as_bytes()).await;
        let (found, error) = answer.into_json().await;
        assert_eq!(
            (found, error["code"].as_str().unwrap(), reason(&error)),
            (status, code, expected.name()),
            "{error}"
        );
        assert!(error["message"].as_str().unwrap().contains(words), "{error}");
    }
    let fields = call(&server, &format!("{WORLD}/CreateWorld"), json!({"map": {"size": {"width": 1}}})).await.1;
    let bad = fields["details"].as_array().unwrap().iter().find(|it| it["type"] == "google.rpc.BadRequest").unwrap();
    assert_eq!(bad["debug"]["fieldViolations"][0]["field"], "map.size.width");
    // Four times the limit of a message, except where messages hold levels.
    let import = "/surefoot.world.v1.MapService/ImportMap".to_owned();
    for (method, bytes, expected) in [
        (&get, (4 << 20) + 1, "TOO_LARGE"),
        (&get, 4 << 20, "MALFORMED_REQUEST"),
        (&import, 5 << 20, "MALFORMED_REQUEST"),
        (&import, (32 << 20) + 1, "TOO_LARGE"),
    ] {
        let mut body = vec![b' '; bytes];
        body[0] = b'?';
        let answer = post(&server, method, "Content-Type: application/json\r\n", &body).await;
        let (status, error) = answer.into_json().await;
        assert_eq!((status, reason(&error)), (400, expected), "{method} {bytes}");
    }
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn tokens_and_protobuf_work_over_plain_http_too() {
    let secret = "0123456789abcdef0123";
    let tokens = Tokens::parse(&format!("[[token]]\nname = \"game\"\nrole = \"client\"\nsecret = \"{secret}\"\n"));
    let security = Security { tokens: Some(tokens.unwrap()), ..Security::default() };
    let server = start_server_at(EndpointConfig { security, ..Default::default() }, ServerConfig::default());
    let list = format!("{WORLD}/ListWorlds");
    let (status, error) = call(&server, &list, json!({})).await;
    assert_eq!((status, error["code"].as_str().unwrap(), reason(&error)), (401, "unauthenticated", "TOKEN_MISSING"));
    let bearer = format!("Authorization: Bearer {secret}\r\n");
    let (status, error) =
        post(&server, &format!("{WORLD}/Work"), &format!("{bearer}Content-Type: application/json\r\n"), b"{}")
            .await
            .into_json()
            .await;
    assert_eq!((status, reason(&error)), (403, "ROLE_FORBIDDEN"));
    let request = wire::GetServerRequest {}.encode_to_vec();
    let kind = format!("{bearer}Content-Type: application/proto\r\n");
    let answer = post(&server, &format!("{WORLD}/GetServer"), &kind, &request).await;
    assert_eq!((answer.status, answer.content_type.as_str()), (200, "application/proto"));
    let about = wire::GetServerResponse::decode(&*answer.into_bytes().await).unwrap();
    assert_eq!(about.ticks_per_second, 60);
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn the_contracts_are_served_as_openapi_and_every_reason_is_documented() {
    let server = start_server(ServerConfig::default());
    let answer = get(&server, "/openapi.json", "").await;
    let document: Value = serde_json::from_str(answer.split_once("\r\n\r\n").unwrap().1).unwrap();
    let schemas = document["components"]["schemas"].as_object().unwrap();
    assert!(document["paths"].get(format!("{WORLD}/Work")).is_none());
    let spawn = &document["paths"][format!("{WORLD}/BatchSpawnNpcs")]["post"];
    assert!(spawn["description"].as_str().unwrap().contains("4096"));
    let lines = &document["paths"][format!("{WORLD}/WatchEvents")]["post"]["responses"]["200"]["content"];
    assert!(lines["application/x-ndjson"].is_object());
    for (name, schema) in schemas.iter().filter(|(name, _)| name.starts_with("surefoot.")) {
        assert!(!schema["description"].as_str().unwrap().is_empty(), "{name} says nothing");
        for (field, about) in schema["properties"].as_object().into_iter().flatten() {
            assert!(!about["description"].as_str().unwrap().is_empty(), "{name}.{field} says nothing");
        }
    }
    let text = document.to_string();
    for reference in text.split("#/components/schemas/").skip(1).map(|rest| rest.split('"').next().unwrap()) {
        assert!(schemas.contains_key(reference), "{reference} is not defined");
    }
    let errors = std::fs::read_to_string(e2e::source::root().join("docs/reference/errors.md")).unwrap();
    for reason in Reason::ALL {
        let heading = format!("\n### {:?}\n", reason.code());
        let section = errors.split(&heading).nth(1).and_then(|rest| rest.split("\n### ").next()).unwrap_or_default();
        let line = format!("\n- `{}`: {}\n", reason.name(), reason.meaning());
        assert!(section.contains(&line), "docs/reference/errors.md lacks below{heading}{line}");
    }
    server.stop().await;
}
