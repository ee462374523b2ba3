//! The schema of the database: which migrations it has, and who applies the others.
//!
//! `surefoot fleet migrate` applies them, under a role that may change tables. Servers and planners need a role for
//! rows only. They check the schema when they start. If it is too old, they apply the migrations themselves if their
//! role may do so, and refuse to start otherwise.
//!
//! Schemas only grow, so that an old version can use a newer one: while a fleet is upgraded, both run.

use sqlx::migrate::{MigrateError, Migrator};
use sqlx::{AssertSqlSafe, PgConnection};

/// SQLSTATE of a missing privilege.
const DENIED: &str = "42501";
/// SQLSTATE of a missing table.
const NO_TABLE: &str = "42P01";

/// What a role needs to read and write rows. It cannot claim that a migration was applied.
const GRANTS: &str = "SELECT format('
    GRANT USAGE ON SCHEMA %1$I TO %2$I;
    GRANT SELECT, INSERT, UPDATE, DELETE ON ALL TABLES IN SCHEMA %1$I TO %2$I;
    GRANT USAGE, SELECT ON ALL SEQUENCES IN SCHEMA %1$I TO %2$I;
    REVOKE INSERT, UPDATE, DELETE ON _sqlx_migrations FROM %2$I', current_schema(), $1::text)";

/// Why a schema cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum SchemaError {
    #[error(
        "the schema lacks migration {missing}, and this role may not change tables ({denied}): run surefoot fleet \
         migrate of this version"
    )]
    Old { missing: i64, denied: MigrateError },
    #[error("{denied}: run surefoot fleet migrate with --role and the name of this role")]
    Unreadable { denied: MigrateError },
    #[error(transparent)]
    Migrate(#[from] MigrateError),
}

impl From<sqlx::Error> for SchemaError {
    fn from(error: sqlx::Error) -> Self {
        Self::Migrate(error.into())
    }
}

/// Checks that the schema is as new as this program. Applies what is missing if the role of the connection may.
pub async fn ensure(connection: &mut PgConnection) -> Result<(), SchemaError> {
    let missing = match first_missing(connection).await {
        Ok(None) => return Ok(()),
        Ok(Some(missing)) => missing,
        Err(denied) if is_denied(&denied) => return Err(SchemaError::Unreadable { denied }),
        Err(error) => return Err(error.into()),
    };
    match migrate(connection).await {
        Err(SchemaError::Migrate(denied)) if is_denied(&denied) => Err(SchemaError::Old { missing, denied }),
        result => result,
    }
}

/// Applies all migrations that are missing.
pub async fn migrate(connection: &mut PgConnection) -> Result<(), SchemaError> {
    // Processes that start together wait for the first one, and changing a large table takes time.
    sqlx::query("SET statement_timeout = 0").execute(&mut *connection).await?;
    Ok(migrations().run(connection).await?)
}

/// Lets `role` read and write rows, but not change tables.
pub async fn grant(connection: &mut PgConnection, role: &str) -> Result<(), SchemaError> {
    let statements: String = sqlx::query_scalar(GRANTS).bind(role).fetch_one(&mut *connection).await?;
    // PostgreSQL has quoted both names.
    sqlx::raw_sql(AssertSqlSafe(statements)).execute(connection).await?;
    Ok(())
}

/// Number of the latest migration of this program.
pub fn version() -> i64 {
    migrations().iter().map(|migration| migration.version).max().unwrap_or(0)
}

fn migrations() -> Migrator {
    let mut migrations = sqlx::migrate!();
    migrations.set_ignore_missing(true);
    migrations
}

/// The first migration of this program that the database lacks.
async fn first_missing(connection: &mut PgConnection) -> Result<Option<i64>, MigrateError> {
    let applied = sqlx::query_as("SELECT version, checksum FROM _sqlx_migrations").fetch_all(connection).await;
    let applied: Vec<(i64, Vec<u8>)> = match applied {
        Err(error) if has_code(&error, NO_TABLE) => Vec::new(),
        applied => applied?,
    };
    for migration in migrations().iter() {
        match applied.iter().find(|(version, _)| *version == migration.version) {
            None => return Ok(Some(migration.version)),
            Some((version, checksum)) if checksum[..] != migration.checksum[..] => {
                return Err(MigrateError::VersionMismatch(*version));
            }
            Some(_) => {}
        }
    }
    Ok(None)
}

fn is_denied(error: &MigrateError) -> bool {
    match error {
        MigrateError::Execute(error) | MigrateError::ExecuteMigration(error, _) => has_code(error, DENIED),
        _ => false,
    }
}

fn has_code(error: &sqlx::Error, code: &str) -> bool {
    error.as_database_error().and_then(|error| error.code()).is_some_and(|found| found == code)
}
