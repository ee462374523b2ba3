//! Membership: a process of the fleet, and the lease that says that it lives. Claims of builds and worlds refer to their member, so that
//! one renewal keeps them all.

use crate::database::Database;
use crate::error::FleetError;
use std::sync::Arc;
use std::time::{Duration, Instant};
use tokio::sync::watch;

/// What a process is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MemberKind {
    /// A world server.
    Server,
    /// A planner.
    Planner,
}

impl MemberKind {
    fn as_str(self) -> &'static str {
        match self {
            Self::Server => "server",
            Self::Planner => "planner",
        }
    }
}

/// A process of the fleet. Clones share its lease.
#[derive(Debug, Clone)]
pub struct Member {
    /// Identifies the process; a process that starts again gets another one.
    pub id: i64,
    database: Database,
    lease: Duration,
    /// Until when no other process takes it for dead, by this machine's clock. `Instant` does not count time in which a virtual machine
    /// is suspended: after one wakes, reads may be stale for up to a lease. Writes are not: the database checks the lease in each.
    until: Arc<watch::Sender<Instant>>,
}

impl Member {
    /// Registers this process, which others reach at `address`, for `lease`.
    ///
    /// # Errors
    /// If the database cannot be written.
    pub async fn join(
        database: &Database,
        kind: MemberKind,
        address: &str,
        lease: Duration,
    ) -> Result<Self, FleetError> {
        // Taken before the database sets the end of the lease, which is therefore later.
        let asked = Instant::now();
        let id = sqlx::query_scalar!(
            "INSERT INTO members (kind, address, expires_at)
             VALUES ($1, $2, now() + make_interval(secs => $3)) RETURNING id",
            kind.as_str(),
            address,
            lease.as_secs_f64(),
        );
        let mut call = database.urgent().await?;
        let id = id.fetch_one(call.connection()).await;
        let id = call.done(id)?;
        let until = Arc::new(watch::Sender::new(asked + lease));
        Ok(Self { id, database: database.clone(), lease, until })
    }

    /// Renews the lease, unless it has expired.
    ///
    /// # Errors
    /// If the database cannot be written, or the lease has expired: whatever the process held may have been taken over.
    pub async fn renew(&self) -> Result<(), FleetError> {
        let asked = Instant::now();
        let renewed = sqlx::query!(
            "UPDATE members SET expires_at = now() + make_interval(secs => $2)
             WHERE id = $1 AND expires_at > now()",
            self.id,
            self.lease.as_secs_f64(),
        );
        let mut call = self.database.urgent().await?;
        let renewed = renewed.execute(call.connection()).await;
        let renewed = call.done(renewed)?;
        if renewed.rows_affected() == 0 {
            return Err(FleetError::new(self.database.place(), "the lease of this process has expired"));
        }
        self.until.send_replace(asked + self.lease);
        Ok(())
    }

    /// Ends the lease, so that others take over at once.
    ///
    /// # Errors
    /// If the database cannot be written; the lease then expires by itself.
    pub async fn leave(&self) -> Result<(), FleetError> {
        let left = sqlx::query!("UPDATE members SET expires_at = now() WHERE id = $1", self.id);
        let mut call = self.database.urgent().await?;
        let left = left.execute(call.connection()).await;
        call.done(left)?;
        self.until.send_replace(Instant::now());
        Ok(())
    }

    /// Whether the lease is certainly valid. While it is not, others may have taken over what this process held.
    pub fn holds_lease(&self) -> bool {
        *self.until.borrow() > Instant::now()
    }

    /// Length of the lease.
    pub fn lease(&self) -> Duration {
        self.lease
    }
}
