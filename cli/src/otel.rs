//! Tracing spans for a collector, over OTLP.

use anyhow::Context;
use opentelemetry::trace::TracerProvider;
use opentelemetry_otlp::{SpanExporter, WithExportConfig};
use opentelemetry_sdk::Resource;
use opentelemetry_sdk::trace::SdkTracerProvider;
use std::time::Duration;
use tokio::runtime::Runtime;
use tracing::Subscriber;
use tracing_subscriber::filter::LevelFilter;
use tracing_subscriber::registry::LookupSpan;
use tracing_subscriber::{EnvFilter, Layer};

/// Longest wait for the collector at the end.
const FINISH_LIMIT: Duration = Duration::from_secs(2);

/// Exports spans in batches until it is finished.
pub struct Spans {
    provider: SdkTracerProvider,
    /// The exporter's connection lives here: it is there before and after the services' own runtime.
    runtime: Runtime,
}

impl Spans {
    /// Connects to the collector at `uri` when there is something to send.
    pub fn start(uri: &str) -> anyhow::Result<Self> {
        let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(1).enable_all().build()?;
        let exporter = {
            let _inside = runtime.enter();
            SpanExporter::builder().with_tonic().with_endpoint(uri).build()
        };
        let exporter = exporter.with_context(|| format!("--otlp {uri} cannot be used"))?;
        let provider = SdkTracerProvider::builder()
            .with_batch_exporter(exporter)
            .with_resource(Resource::builder().with_service_name("surefoot").build())
            .build();
        Ok(Self { provider, runtime })
    }

    /// Turns spans into exported ones: those of Surefoot, and what `RUST_LOG` asks for.
    pub fn layer<S>(&self) -> impl Layer<S> + use<S>
    where
        S: Subscriber + for<'a> LookupSpan<'a> + Send + Sync,
    {
        let filter = EnvFilter::builder().with_default_directive(LevelFilter::INFO.into()).from_env_lossy();
        tracing_opentelemetry::layer().with_tracer(self.provider.tracer("surefoot")).with_filter(filter)
    }

    /// Sends what has not been sent yet; a collector that does not answer must not hold the process for long.
    pub fn finish(self) {
        if let Err(error) = self.provider.shutdown_with_timeout(FINISH_LIMIT) {
            tracing::warn!(%error, "some spans were not sent");
        }
        self.runtime.shutdown_background();
    }
}
