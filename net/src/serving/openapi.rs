//! The contracts as an OpenAPI document for clients with HTTP and JSON, built from the descriptors with their comments.

use super::methods::POOL;
use prost_reflect::{EnumDescriptor, FieldDescriptor, Kind, MessageDescriptor, MethodDescriptor};
use serde_json::{Map, Value, json};
use std::collections::BTreeMap;

/// Field numbers in `descriptor.proto` that occur in the paths of comments.
const MESSAGES: i32 = 4;
const ENUMS: i32 = 5;
const SERVICES: i32 = 6;
const MEMBERS: i32 = 2;

/// Returns the document of the services with the given full names, as JSON.
pub(super) fn document(services: &[String]) -> String {
    let comments = comments();
    let mut schemas = Schemas { comments: &comments, found: BTreeMap::new() };
    let mut paths = Map::new();
    for service in POOL.services().filter(|service| services.iter().any(|name| name == service.full_name())) {
        // Client streams need gRPC.
        for method in service.methods().filter(|method| !method.is_client_streaming()) {
            let path = format!("/{}/{}", service.full_name(), method.name());
            paths.insert(path, json!({ "post": schemas.operation(service.name(), &method) }));
        }
    }
    let mut schemas: Map<String, Value> = schemas.found.into_iter().collect();
    schemas.insert("Error".to_owned(), error_schema());
    let document = json!({
        "openapi": "3.1.0",
        "info": {
            "title": "Surefoot",
            "version": env!("CARGO_PKG_VERSION"),
            "description": "Unary calls take and return JSON (the Connect protocol). Streams return one JSON document \
                            per line; a last line {\"error\": ...} means that the stream failed. 64-bit integers are \
                            strings.",
        },
        "paths": paths,
        "components": {
            "schemas": schemas,
            "securitySchemes": { "token": { "type": "http", "scheme": "bearer" } },
        },
        "security": [{}, { "token": [] }],
    });
    serde_json::to_string_pretty(&document).expect("plain data")
}

/// Returns the leading comment of each message, field, enum, value and method, by full name.
fn comments() -> BTreeMap<String, String> {
    let mut found = BTreeMap::new();
    for file in POOL.files() {
        let file = file.file_descriptor_proto();
        let locations = file.source_code_info.iter().flat_map(|info| &info.location);
        for location in locations.filter(|location| location.leading_comments.is_some()) {
            let name = match location.path[..] {
                [MESSAGES, at] => file.message_type.get(at as usize).and_then(|it| it.name.clone()),
                [ENUMS, at] => file.enum_type.get(at as usize).and_then(|it| it.name.clone()),
                [MESSAGES, at, MEMBERS, member] => file
                    .message_type
                    .get(at as usize)
                    .and_then(|it| Some(format!("{}.{}", it.name(), it.field.get(member as usize)?.name()))),
                [ENUMS, at, MEMBERS, member] => file
                    .enum_type
                    .get(at as usize)
                    .and_then(|it| Some(format!("{}.{}", it.name(), it.value.get(member as usize)?.name()))),
                [SERVICES, at, MEMBERS, member] => file
                    .service
                    .get(at as usize)
                    .and_then(|it| Some(format!("{}.{}", it.name(), it.method.get(member as usize)?.name()))),
                _ => None,
            };
            if let Some(name) = name {
                let lines = location.leading_comments().lines().map(str::trim).collect::<Vec<_>>();
                found.insert(format!("{}.{name}", file.package()), lines.join(" ").trim().to_owned());
            }
        }
    }
    found
}

/// Schemas of the messages and enums found so far.
struct Schemas<'a> {
    comments: &'a BTreeMap<String, String>,
    found: BTreeMap<String, Value>,
}

impl Schemas<'_> {
    fn comment(&self, name: &str) -> &str {
        self.comments.get(name).map_or("", String::as_str)
    }

    fn operation(&mut self, service: &str, method: &MethodDescriptor) -> Value {
        let kind = if method.is_server_streaming() { "application/x-ndjson" } else { "application/json" };
        json!({
            "operationId": format!("{service}_{}", method.name()),
            "tags": [service],
            "description": self.comment(method.full_name()).to_owned(),
            "requestBody": {
                "required": true,
                "content": { "application/json": { "schema": self.message(&method.input()) } },
            },
            "responses": {
                "200": { "description": "", "content": { kind: { "schema": self.message(&method.output()) } } },
                "default": {
                    "description": "The call failed.",
                    "content": { "application/json": { "schema": { "$ref": "#/components/schemas/Error" } } },
                },
            },
        })
    }

    fn message(&mut self, message: &MessageDescriptor) -> Value {
        if message.full_name() == "google.protobuf.Timestamp" {
            return json!({ "type": "string", "format": "date-time" });
        }
        let name = message.full_name().to_owned();
        if !self.found.contains_key(&name) {
            // Inserted before its fields are visited, because a message may contain itself.
            self.found.insert(name.clone(), Value::Null);
            let fields: Map<String, Value> =
                message.fields().map(|field| (field.json_name().to_owned(), self.field(&field))).collect();
            let schema = json!({ "type": "object", "description": self.comment(&name), "properties": fields });
            self.found.insert(name.clone(), schema);
        }
        json!({ "$ref": format!("#/components/schemas/{name}") })
    }

    fn field(&mut self, field: &FieldDescriptor) -> Value {
        let value = match field.kind() {
            Kind::Message(message) => self.message(&message),
            Kind::Enum(values) => self.values(&values),
            Kind::Bool => json!({ "type": "boolean" }),
            Kind::String => json!({ "type": "string" }),
            Kind::Bytes => json!({ "type": "string", "contentEncoding": "base64" }),
            Kind::Float | Kind::Double => json!({ "type": "number" }),
            Kind::Int64 | Kind::Sint64 | Kind::Sfixed64 => json!({ "type": "string", "format": "int64" }),
            Kind::Uint64 | Kind::Fixed64 => json!({ "type": "string", "format": "uint64" }),
            Kind::Int32 | Kind::Sint32 | Kind::Sfixed32 => json!({ "type": "integer", "format": "int32" }),
            Kind::Uint32 | Kind::Fixed32 => json!({ "type": "integer", "format": "uint32" }),
        };
        let mut schema = if field.is_list() { json!({ "type": "array", "items": value }) } else { value };
        let mut comment = self.comment(field.full_name()).to_owned();
        if let Some(group) = field.containing_oneof().filter(|group| !group.is_synthetic()) {
            comment += &format!(" Only one field of `{}` is set.", group.name());
        }
        schema["description"] = comment.trim().into();
        schema
    }

    fn values(&mut self, values: &EnumDescriptor) -> Value {
        let name = values.full_name().to_owned();
        if !self.found.contains_key(&name) {
            let names: Vec<String> = values.values().map(|value| value.name().to_owned()).collect();
            let meanings = names.iter().map(|value| format!("{value}: {}", self.comment(&format!("{name}.{value}"))));
            let description = format!("{} {}", self.comment(&name), meanings.collect::<Vec<_>>().join(" "));
            let schema = json!({ "type": "string", "enum": names, "description": description.trim() });
            self.found.insert(name.clone(), schema);
        }
        json!({ "$ref": format!("#/components/schemas/{name}") })
    }
}

fn error_schema() -> Value {
    json!({
        "type": "object",
        "properties": {
            "code": { "type": "string", "description": "The gRPC code in lower case, such as not_found." },
            "message": { "type": "string", "description": "What went wrong, for developers." },
            "details": {
                "type": "array",
                "description": "Details of google.rpc; debug.reason of the google.rpc.ErrorInfo is a stable reason.",
                "items": {
                    "type": "object",
                    "properties": {
                        "type": { "type": "string" },
                        "value": { "type": "string", "contentEncoding": "base64" },
                        "debug": { "type": "object" },
                    },
                },
            },
        },
    })
}
