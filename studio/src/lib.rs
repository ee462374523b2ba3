//! Studio: a page for browsers, built from `page/` and embedded here. It talks to the services over gRPC-Web; this crate only
//! hands its files out and knows nothing of worlds or plans.

use axum::Router;
use axum::http::{HeaderName, StatusCode, Uri, header};
use axum::response::{Html, IntoResponse, Response};
use axum::routing::get;

/// A file of the page.
struct File {
    path: &'static str,
    content: &'static [u8],
}

include!(concat!(env!("OUT_DIR"), "/files.rs"));

/// Nothing comes from anywhere else; the services may be anywhere.
const POLICY: &str = "default-src 'self'; connect-src *; img-src 'self' data: blob:; style-src 'self' 'unsafe-inline'; \
                      worker-src 'self' blob:; frame-ancestors 'none'; base-uri 'none'; form-action 'none'";

/// Why this build has no page; `None` if it has one.
pub fn missing() -> Option<&'static str> {
    FILES.is_empty().then_some(MISSING)
}

/// The page's files, and `studio.json`, which tells it where the planner is: a URL, or `:7601` for that port of the host that
/// the page comes from. In a build without the page a text that says how to get it.
pub fn pages(planner: &str) -> Router {
    let settings = serde_json::json!({ "planner": planner }).to_string();
    let settings = ([(header::CONTENT_TYPE, "application/json"), (header::CACHE_CONTROL, "no-cache")], settings);
    Router::new().route("/studio.json", get(async move || settings)).fallback(file)
}

async fn file(uri: Uri) -> Response {
    let path = match uri.path().trim_start_matches('/') {
        "" => "index.html",
        path => path,
    };
    if let Some(reason) = missing() {
        return without_page(path, reason);
    }
    let Some(file) = FILES.iter().find(|file| file.path == path) else {
        return (StatusCode::NOT_FOUND, format!("there is no page {}\n", uri.path())).into_response();
    };
    // Names of assets hold a hash of what is in them.
    let kept = if path.starts_with("assets/") { "public, max-age=31536000, immutable" } else { "no-cache" };
    let headers: [(HeaderName, &str); 5] = [
        (header::CONTENT_TYPE, kind_of(path)),
        (header::CACHE_CONTROL, kept),
        (header::CONTENT_SECURITY_POLICY, POLICY),
        (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
        (header::REFERRER_POLICY, "no-referrer"),
    ];
    (headers, file.content).into_response()
}

fn without_page(path: &str, reason: &str) -> Response {
    if path != "index.html" {
        return (StatusCode::NOT_FOUND, "this build has no pages\n").into_response();
    }
    let reason = reason.replace('&', "&amp;").replace('<', "&lt;");
    let text = format!(
        "<!doctype html><meta charset=utf-8><title>Surefoot</title>\
         <style>body {{ font: 16px/1.5 system-ui; max-width: 40rem; margin: 4rem auto; padding: 0 1rem }}</style>\
         <h1>Surefoot is running</h1><p>Studio is not part of this build: {reason}.</p>\
         <p>To get it, install Node.js 20.19 or later with npm and build again: <code>SUREFOOT_STUDIO=require cargo build --release</code>. \
         The Docker image always has it. All services work without it.</p>"
    );
    Html(text).into_response()
}

fn kind_of(path: &str) -> &'static str {
    match path.rsplit_once('.').map(|(_, suffix)| suffix) {
        Some("html") => "text/html; charset=utf-8",
        Some("js") => "text/javascript",
        Some("css") => "text/css",
        Some("svg") => "image/svg+xml",
        Some("png") => "image/png",
        Some("json") => "application/json",
        Some("wasm") => "application/wasm",
        Some("woff2") => "font/woff2",
        _ => "application/octet-stream",
    }
}
