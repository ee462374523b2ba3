//! The PostgreSQL database that all servers and planners of a fleet share.
//!
//! Its schema is in `migrations/`, and `schema` checks it at every start. Queries are checked when they are compiled,
//! against the descriptions in `.sqlx`, which `tests/fleet/check` compares with a database.

use crate::error::FleetError;
use crate::schema;
use sqlx::pool::PoolConnection;
use sqlx::postgres::{PgConnectOptions, PgPool, PgPoolOptions};
use sqlx::{PgConnection, Postgres};
use std::str::FromStr;
use std::time::Duration;

/// Longest wait for a connection, and for the database to come up at start.
const PATIENCE: Duration = Duration::from_secs(5);
/// Longest time that the database works on a statement. Callers give up earlier.
const STATEMENT_TIMEOUT: &str = "5s";
/// Maximum number of connections for calls that may wait a moment, including the one that listens.
const MAX_CONNECTIONS: u32 = 6;
/// Maximum number of connections for leases and journals.
const MAX_URGENT: u32 = 2;
/// Maximum number of connections for look-ups by clients.
const MAX_LOOKUPS: u32 = 2;

/// Connections to the database. Clones share them.
///
/// They are divided into three pools, so that a lease is renewed in time however many clients send look-ups.
#[derive(Debug, Clone)]
pub struct Database {
    /// For calls that may wait a moment.
    pub pool: PgPool,
    /// For look-ups by clients, whose number is not limited. The size of the pool bounds their load on the database.
    pub lookups: PgPool,
    urgent: PgPool,
}

/// A connection for a call that must not wait behind others. It is closed if the call is dropped or fails: a broken
/// connection must not stay in a small pool.
#[derive(Debug)]
pub struct Urgent {
    connection: PoolConnection<Postgres>,
    is_done: bool,
}

impl Urgent {
    /// The connection.
    pub fn connection(&mut self) -> &mut PgConnection {
        &mut self.connection
    }

    /// Ends the call.
    pub fn done<T>(mut self, result: Result<T, sqlx::Error>) -> Result<T, sqlx::Error> {
        self.is_done = result.is_ok();
        result
    }
}

impl Drop for Urgent {
    fn drop(&mut self) {
        if !self.is_done {
            self.connection.close_on_drop();
        }
    }
}

impl Database {
    /// Connects to `url`, `postgres://user:password@host:port/database`, and checks the schema. An older schema is
    /// brought up to date if the role in `url` may do so.
    pub async fn open(url: &str) -> Result<Self, FleetError> {
        let server = Server::parse(url)?;
        let pool = server.connect(MAX_CONNECTIONS).await?;
        let mut connection = server.session(&pool).await?;
        schema::ensure(&mut connection).await.map_err(|error| server.fail(&error))?;
        let lazily = |count| pool_of(count).connect_lazy_with(server.options.clone());
        Ok(Self { pool, lookups: lazily(MAX_LOOKUPS), urgent: lazily(MAX_URGENT) })
    }

    /// A connection for leases and journals.
    pub async fn urgent(&self) -> Result<Urgent, sqlx::Error> {
        Ok(Urgent { connection: self.urgent.acquire().await?, is_done: false })
    }

    /// Returns the number of transactions that the database has committed for all its clients. For measurements.
    pub async fn commits(&self) -> Result<i64, FleetError> {
        let count = sqlx::query_scalar!(
            r#"SELECT xact_commit AS "count!" FROM pg_stat_database WHERE datname = current_database()"#
        );
        Ok(count.fetch_one(&self.pool).await?)
    }
}

/// Brings the schema of the database at `url` up to date, and lets `role` read and write its rows. Returns the address
/// of the database and the number of its latest migration.
pub async fn migrate(url: &str, role: Option<&str>) -> Result<(String, i64), FleetError> {
    let server = Server::parse(url)?;
    let pool = server.connect(1).await?;
    let mut connection = server.session(&pool).await?;
    schema::migrate(&mut connection).await.map_err(|error| server.fail(&error))?;
    if let Some(role) = role {
        schema::grant(&mut connection, role).await.map_err(|error| server.fail(&error))?;
    }
    Ok((server.place, schema::version()))
}

fn pool_of(max_connections: u32) -> PgPoolOptions {
    PgPoolOptions::new().max_connections(max_connections).acquire_timeout(PATIENCE)
}

/// A database server, and how to connect to it.
struct Server {
    /// Its address, without the password.
    place: String,
    options: PgConnectOptions,
}

impl Server {
    fn parse(url: &str) -> Result<Self, FleetError> {
        let malformed = |why: String| {
            FleetError::new("--store", format!("{why}the format is postgres://user:password@host:port/database"))
        };
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
        let options = options.application_name("surefoot").options([
            // A process that is stopped within a transaction must not hold its locks for long.
            ("idle_in_transaction_session_timeout", "2s"),
            ("statement_timeout", STATEMENT_TIMEOUT),
        ]);
        Ok(Self { place, options })
    }

    async fn connect(&self, max_connections: u32) -> Result<PgPool, FleetError> {
        pool_of(max_connections).connect_with(self.options.clone()).await.map_err(|error| self.fail(&error))
    }

    /// A connection whose settings may be changed: it is closed afterwards.
    async fn session(&self, pool: &PgPool) -> Result<PoolConnection<Postgres>, FleetError> {
        let mut connection = pool.acquire().await.map_err(|error| self.fail(&error))?;
        connection.close_on_drop();
        Ok(connection)
    }

    fn fail(&self, error: &dyn std::fmt::Display) -> FleetError {
        FleetError::new(self.place.clone(), error.to_string())
    }
}
