//! Export of tracing spans to a collector over OTLP.

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

/// Longest wait for the collector at shutdown.
const FINISH_LIMIT: Duration = Duration::from_secs(2);

/// Exports spans in batches until [`finish`](Self::finish).
pub struct Spans {
    provider: SdkTracerProvider,
    /// Runs the exporter's connection, which starts before the services' runtime and ends after it.
    runtime: Runtime,
}

impl Spans {
    /// Prepares the export to the collector at `uri`; the connection opens with the first batch.
    pub fn start(uri: &str) -> anyhow::Result<Self> {
        let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(1).enable_all().build()?;
        let exporter = {
            let _inside = runtime.enter();
            SpanExporter::builder().with_tonic().with_endpoint(uri).build()
        };
        let exporter = exporter.with_context(|| format!("cannot use --otlp {uri}"))?;
        let provider = SdkTracerProvider::builder()
            .with_batch_exporter(exporter)
            .with_resource(Resource::builder().with_service_name("surefoot").build())
            .build();
        Ok(Self { provider, runtime })
    }

    /// A layer that exports spans at the levels that `RUST_LOG` selects, by default info and above.
    pub fn layer<S>(&self) -> impl Layer<S> + use<S>
    where
        S: Subscriber + for<'a> LookupSpan<'a> + Send + Sync,
    {
        let filter = EnvFilter::builder().with_default_directive(LevelFilter::INFO.into()).from_env_lossy();
        tracing_opentelemetry::layer().with_tracer(self.provider.tracer("surefoot")).with_filter(filter)
    }

    /// Sends the remaining spans; waits at most 2 s for the collector.
    pub fn finish(self) {
        if let Err(error) = self.provider.shutdown_with_timeout(FINISH_LIMIT) {
            tracing::warn!(%error, "some spans were not sent");
        }
        self.runtime.shutdown_background();
    }
}
