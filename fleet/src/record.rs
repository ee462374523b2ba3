//! The record: a PostgreSQL database that all servers and planners of a fleet share.
//!
//! Its schema is in `migrations/`, applied at start by whoever starts first. Queries are checked against it when they are compiled, from
//! the descriptions in `.sqlx`, which `tests/fleet/check` compares with a database.

use crate::error::FleetError;
use sqlx::postgres::{PgConnectOptions, PgPool, PgPoolOptions};
use std::str::FromStr;
use std::time::Duration;

/// Longest wait for a connection, and for the database to come up at start.
const PATIENCE: Duration = Duration::from_secs(5);
/// Most connections of a process.
const MAX_CONNECTIONS: u32 = 8;

/// A connection pool to the record. Clones share it.
#[derive(Debug, Clone)]
pub struct Record {
    /// The connections.
    pub pool: PgPool,
    place: String,
}

impl Record {
    /// Connects to `url`, `postgres://user:password@host:port/database`, and brings the schema up to date.
    ///
    /// # Errors
    /// If the URL is malformed, the database does not answer within 5 s, or its schema cannot be brought up to date.
    pub async fn open(url: &str) -> Result<Self, FleetError> {
        let malformed =
            |why: String| FleetError::new("--store", format!("{why}it is postgres://user:password@host:port/database"));
        if !url.starts_with("postgres://") && !url.starts_with("postgresql://") {
            return Err(malformed(String::new()));
        }
        let options = PgConnectOptions::from_str(url).map_err(|error| malformed(format!("{error}; ")))?;
        let place = format!(
            "postgres://{}:{}/{}",
            options.get_host(),
            options.get_port(),
            options.get_database().unwrap_or_default()
        );
        let fail = |error: &dyn std::fmt::Display| FleetError::new(place.clone(), error.to_string());
        let pool = PgPoolOptions::new().max_connections(MAX_CONNECTIONS).acquire_timeout(PATIENCE);
        // A process that was stopped within a transaction must not keep others waiting for its locks.
        let options = options.application_name("surefoot").options([("idle_in_transaction_session_timeout", "2s")]);
        let pool = pool.connect_with(options).await.map_err(|error| fail(&error))?;
        // Schemas only grow, so that one of a newer version serves this one as well: while a fleet is upgraded, both run.
        sqlx::migrate!().set_ignore_missing(true).run(&pool).await.map_err(|error| fail(&error))?;
        Ok(Self { pool, place })
    }

    /// Number of transactions that the database has committed so far, of all its clients, as its statistics say, for measurements.
    ///
    /// # Errors
    /// If the record cannot be read.
    pub async fn commits(&self) -> Result<i64, FleetError> {
        let count = sqlx::query_scalar!(
            r#"SELECT xact_commit AS "count!" FROM pg_stat_database WHERE datname = current_database()"#
        );
        count.fetch_one(&self.pool).await.map_err(|error| self.failed(error))
    }

    /// Address of the record, without its password.
    pub fn place(&self) -> &str {
        &self.place
    }

    /// Converts a failure of a query.
    pub fn failed(&self, error: sqlx::Error) -> FleetError {
        FleetError::new(self.place.clone(), error)
    }
}
