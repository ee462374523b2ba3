//! Membership: a process of the fleet, and its lease. Claims of builds and worlds refer to their member, so that one
//! renewal keeps them all. A process whose lease has expired has lost its claims, and joins again as another member.

use crate::database::Database;
use crate::error::FleetError;
use parking_lot::Mutex;
use std::time::{Duration, Instant};

/// The service that a process runs.
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

/// The membership of this process.
#[derive(Debug)]
pub struct Membership {
    database: Database,
    kind: MemberKind,
    address: String,
    lease: Duration,
    current: Mutex<Member>,
}

#[derive(Debug, Clone, Copy)]
struct Member {
    id: i64,
    /// When other processes may take over its claims, by this machine's clock. `Instant` does not count time in which a
    /// virtual machine is suspended: after one wakes, reads may be stale for up to a lease. Writes are not: the
    /// database checks the lease in each.
    until: Instant,
}

impl Membership {
    /// Registers this process, which others reach at `address`, for `lease`.
    pub async fn join(
        database: &Database,
        kind: MemberKind,
        address: &str,
        lease: Duration,
    ) -> Result<Self, FleetError> {
        let member = insert(database, kind, address, lease).await?;
        let (database, address, current) = (database.clone(), address.to_owned(), Mutex::new(member));
        Ok(Self { database, kind, address, lease, current })
    }

    /// Registers this process as another member.
    pub async fn rejoin(&self) -> Result<(), FleetError> {
        let member = insert(&self.database, self.kind, &self.address, self.lease).await?;
        *self.current.lock() = member;
        Ok(())
    }

    /// Renews the lease. Returns false if it has expired, so that others may have taken over the claims of the member.
    pub async fn renew(&self) -> Result<bool, FleetError> {
        let (asked, id) = (Instant::now(), self.id());
        let renewed = sqlx::query!(
            "UPDATE members SET expires_at = now() + make_interval(secs => $2)
             WHERE id = $1 AND expires_at > now()",
            id,
            self.lease.as_secs_f64(),
        );
        let mut call = self.database.urgent().await?;
        let renewed = renewed.execute(call.connection()).await;
        let is_renewed = call.done(renewed)?.rows_affected() > 0;
        if is_renewed {
            self.expire_at(id, asked + self.lease);
        }
        Ok(is_renewed)
    }

    /// Ends the lease, so that others take over at once. If that fails, the lease expires by itself.
    pub async fn leave(&self) -> Result<(), FleetError> {
        let id = self.id();
        let left = sqlx::query!("UPDATE members SET expires_at = now() WHERE id = $1", id);
        let mut call = self.database.urgent().await?;
        let left = left.execute(call.connection()).await;
        call.done(left)?;
        self.expire_at(id, Instant::now());
        Ok(())
    }

    fn expire_at(&self, id: i64, until: Instant) {
        let mut current = self.current.lock();
        if current.id == id {
            current.until = until;
        }
    }

    /// Returns the id of the member that this process is now.
    pub fn id(&self) -> i64 {
        self.current.lock().id
    }

    /// Whether the lease is certainly valid. Otherwise, others may have taken over the claims of the member.
    pub fn holds_lease(&self) -> bool {
        self.current.lock().until > Instant::now()
    }

    /// Returns the length of the lease.
    pub fn lease(&self) -> Duration {
        self.lease
    }
}

async fn insert(database: &Database, kind: MemberKind, address: &str, lease: Duration) -> Result<Member, FleetError> {
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
    Ok(Member { id: call.done(id)?, until: asked + lease })
}
