//! Studio: a page for browsers, built from `page/` and embedded here. It talks to the services over Connect; this crate
//! only serves its files; it has no knowledge of worlds or plans.

mod policy;

pub use policy::{Origin, PlannerAddress, Settings};

use axum::Router;
use axum::extract::State;
use axum::http::{HeaderMap, HeaderName, StatusCode, Uri, header};
use axum::response::{Html, IntoResponse, Response};
use axum::routing::get;
use std::sync::Arc;

/// A file of the page.
struct File {
    path: &'static str,
    content: &'static [u8],
}

include!(concat!(env!("OUT_DIR"), "/files.rs"));

/// Why this build has no page; `None` if it has one.
pub fn missing() -> Option<&'static str> {
    FILES.is_empty().then_some(MISSING)
}

/// The page's files, and `studio.json`, which tells the page where the planner is: a URL, or `:7601` for that port of
/// the host that the page comes from. In a build without the page a text that says how to get it.
pub fn pages(settings: Settings) -> Router {
    let told = serde_json::json!({ "planner": settings.planner.to_string() }).to_string();
    let told = ([(header::CONTENT_TYPE, "application/json"), (header::CACHE_CONTROL, "no-cache")], told);
    Router::new().route("/studio.json", get(async move || told)).fallback(file).with_state(Arc::new(settings))
}

async fn file(State(settings): State<Arc<Settings>>, uri: Uri, headers: HeaderMap) -> Response {
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
    // The names of assets contain a hash of their content.
    let kept = if path.starts_with("assets/") { "public, max-age=31536000, immutable" } else { "no-cache" };
    let policy = policy::policy(&settings, host_of(&uri, &headers).as_deref());
    let headers: [(HeaderName, &str); 5] = [
        (header::CONTENT_TYPE, kind_of(path)),
        (header::CACHE_CONTROL, kept),
        (header::CONTENT_SECURITY_POLICY, policy.as_str()),
        (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
        (header::REFERRER_POLICY, "no-referrer"),
    ];
    (headers, file.content).into_response()
}

/// The host that the page is read from: part of the URI in HTTP/2, a header in HTTP/1.1.
fn host_of(uri: &Uri, headers: &HeaderMap) -> Option<String> {
    if let Some(host) = uri.host() {
        return Some(host.to_owned());
    }
    let named: Uri = headers.get(header::HOST)?.to_str().ok()?.parse().ok()?;
    named.host().map(str::to_owned)
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
         <p>To get it, install Node.js 20.19 or later with npm and build again: <code>SUREFOOT_STUDIO=require cargo \
         build --release</code>. \
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
