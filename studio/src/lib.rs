//! Studio: a page for browsers, built from `page/` and embedded in this crate. The page talks to the services over gRPC-Web; this
//! crate only serves its files.

use axum::Router;
use axum::http::{HeaderName, StatusCode, Uri, header};
use axum::response::{Html, IntoResponse, Response};
use axum::routing::get;

/// A file of the page.
struct File {
    /// Path below the root of the page, with `/` as separator.
    path: &'static str,
    content: &'static [u8],
}

include!(concat!(env!("OUT_DIR"), "/files.rs"));

/// Content security policy: the page loads nothing from other origins, but may connect to services anywhere.
const CONTENT_POLICY: &str = "default-src 'self'; connect-src *; img-src 'self' data: blob:; style-src 'self' 'unsafe-inline'; \
                      worker-src 'self' blob:; frame-ancestors 'none'; base-uri 'none'; form-action 'none'";

/// Returns the reason why this build has no page; `None` if it has one.
pub fn missing() -> Option<&'static str> {
    FILES.is_empty().then_some(MISSING)
}

/// Creates the routes for the page's files and for `studio.json`, which gives the page the address of the planner: a URL, or
/// `:7601` for that port of the host that serves the page. A build without the page serves instructions for including it.
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
    // Names of assets contain a hash of their content.
    let cache_control = if path.starts_with("assets/") { "public, max-age=31536000, immutable" } else { "no-cache" };
    let headers: [(HeaderName, &str); 5] = [
        (header::CONTENT_TYPE, content_type(path)),
        (header::CACHE_CONTROL, cache_control),
        (header::CONTENT_SECURITY_POLICY, CONTENT_POLICY),
        (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
        (header::REFERRER_POLICY, "no-referrer"),
    ];
    (headers, file.content).into_response()
}

fn without_page(path: &str, reason: &str) -> Response {
    if path != "index.html" {
        return (StatusCode::NOT_FOUND, "this build does not include Studio\n").into_response();
    }
    let reason = reason.replace('&', "&amp;").replace('<', "&lt;");
    let text = format!(
        "<!doctype html><meta charset=utf-8><title>Surefoot</title>\
         <style>body {{ font: 16px/1.5 system-ui; max-width: 40rem; margin: 4rem auto; padding: 0 1rem }}</style>\
         <h1>Surefoot is running</h1><p>Studio is not part of this build: {reason}.</p>\
         <p>To include it, install Node.js 20.19 or later with npm and build again: <code>SUREFOOT_STUDIO=require cargo build --release</code>. \
         The Docker image always includes it. All services work without it.</p>"
    );
    Html(text).into_response()
}

fn content_type(path: &str) -> &'static str {
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
