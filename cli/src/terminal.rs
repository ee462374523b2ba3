//! Logs, progress and JSON on the terminal. Results go to stdout, logs and progress to stderr.

use indicatif::{ProgressBar, ProgressStyle};
use std::io::{IsTerminal, Write};
use std::time::Duration;
use tracing_subscriber::layer::SubscriberExt;
use tracing_subscriber::util::SubscriberInitExt;
use tracing_subscriber::{EnvFilter, Layer};

/// Format of log lines.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum LogFormat {
    /// For people
    Text,
    /// One JSON object per line, for programs
    Json,
}

/// Logging flags of every subcommand.
#[derive(clap::Args)]
pub struct LogArgs {
    /// Format of logs on stderr; RUST_LOG selects the level, by default info
    #[arg(long, global = true, value_name = "FORMAT", default_value = "text")]
    log_format: LogFormat,
    /// Export tracing spans to this collector over OTLP (gRPC), such as http://127.0.0.1:4317
    #[cfg(feature = "otel")]
    #[arg(long, global = true, value_name = "URI")]
    otlp: Option<String>,
}

/// State of logging for the lifetime of the process; call [`finish`](Self::finish) at the end to send the remaining
/// spans.
pub struct Logging {
    #[cfg(feature = "otel")]
    spans: Option<crate::otel::Spans>,
}

impl Logging {
    /// Sends logs to stderr; `RUST_LOG` selects the level, by default `info`.
    pub fn start(args: &LogArgs) -> anyhow::Result<Self> {
        let filter = EnvFilter::try_from_default_env().unwrap_or_else(|_| EnvFilter::new("info"));
        let lines = tracing_subscriber::fmt::layer().with_writer(std::io::stderr).with_target(false);
        let lines = match args.log_format {
            LogFormat::Text => lines.with_ansi(std::io::stderr().is_terminal()).boxed(),
            LogFormat::Json => lines.json().flatten_event(true).boxed(),
        };
        let registry = tracing_subscriber::registry().with(lines.with_filter(filter));
        #[cfg(feature = "otel")]
        {
            let spans = args.otlp.as_deref().map(crate::otel::Spans::start).transpose()?;
            registry.with(spans.as_ref().map(crate::otel::Spans::layer)).init();
            Ok(Self { spans })
        }
        #[cfg(not(feature = "otel"))]
        {
            registry.init();
            Ok(Self {})
        }
    }

    /// Sends the remaining spans.
    pub fn finish(self) {
        #[cfg(feature = "otel")]
        if let Some(spans) = self.spans {
            spans.finish();
        }
    }
}

/// A progress bar that is drawn only on a terminal.
pub fn progress_bar(total: u64, what: &'static str) -> ProgressBar {
    let bar = ProgressBar::new(total);
    let style = ProgressStyle::with_template("{msg} [{bar:40}] {pos}/{len} {elapsed} left {eta}");
    bar.set_style(style.expect("a valid template").progress_chars("=> "));
    bar.set_message(what);
    bar
}

/// Runs `work` beside a progress bar, which it sets to a name and to the numbers of finished and of all attempts.
pub fn with_bar<T, E>(
    message: &'static str,
    work: impl FnOnce(&mut dyn FnMut(&str, usize, usize)) -> Result<T, E>,
) -> Result<T, E> {
    let bar = progress_bar(1, message);
    let result = work(&mut |name, done, total| {
        bar.set_message(name.to_owned());
        bar.set_length(total as u64);
        bar.set_position(done as u64);
    });
    bar.finish_and_clear();
    result
}

/// Runs `work`, whose progress is not known, beside a spinner, which is drawn only on a terminal.
pub fn with_spinner<T>(message: &'static str, work: impl FnOnce() -> T) -> T {
    let bar = ProgressBar::new_spinner().with_message(message);
    bar.set_style(ProgressStyle::with_template("{spinner} {msg} {elapsed}").expect("a valid template"));
    bar.enable_steady_tick(Duration::from_millis(100));
    let result = work();
    bar.finish_and_clear();
    result
}

/// Whether stdout is a terminal.
pub fn is_interactive() -> bool {
    std::io::stdout().is_terminal()
}

/// Prints one JSON document on stdout.
pub fn print_json(value: &impl serde::Serialize) -> anyhow::Result<()> {
    let mut out = std::io::stdout().lock();
    serde_json::to_writer_pretty(&mut out, value)?;
    writeln!(out)?;
    Ok(())
}
