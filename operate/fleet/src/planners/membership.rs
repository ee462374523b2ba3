//! A planner among the others. One that was silent for its lease has lost its claims, and goes on as a new member.

use crate::database::Database;
use crate::error::FleetError;
use crate::member::{Member, MemberKind};
use std::sync::RwLock;
use std::time::Duration;
use tracing::warn;

const POISON: &str = "no holder of this lock panics";

/// A planner among the others.
#[derive(Debug)]
pub struct Membership {
    database: Database,
    address: String,
    lease: Duration,
    current: RwLock<Member>,
}

impl Membership {
    /// Joins, for `lease`; others reach the planner at `address`.
    ///
    /// # Errors
    /// If the database cannot be written.
    pub async fn join(database: &Database, address: String, lease: Duration) -> Result<Self, FleetError> {
        let member = Member::join(database, MemberKind::Planner, &address, lease).await?;
        Ok(Self { database: database.clone(), address, lease, current: RwLock::new(member) })
    }

    fn current(&self) -> Member {
        self.current.read().expect(POISON).clone()
    }

    /// Identifies the member that this planner is now.
    pub fn id(&self) -> i64 {
        self.current().id
    }

    /// Whether no other planner can have taken over what this one builds.
    pub fn holds_lease(&self) -> bool {
        self.current().holds_lease()
    }

    /// Renews the lease, or joins again if it has expired.
    ///
    /// # Errors
    /// If the database cannot be written.
    pub async fn renew(&self) -> Result<(), FleetError> {
        let member = self.current();
        let Err(error) = member.renew().await else { return Ok(()) };
        let lives =
            sqlx::query_scalar!(r#"SELECT expires_at > now() AS "lives!" FROM members WHERE id = $1"#, member.id);
        let lives = lives.fetch_optional(&self.database.pool).await.map_err(|error| self.database.failed(error))?;
        if lives == Some(true) {
            return Err(error);
        }
        warn!(member = member.id, "this planner was taken for dead: it joins again");
        let again = Member::join(&self.database, MemberKind::Planner, &self.address, self.lease).await?;
        *self.current.write().expect(POISON) = again;
        Ok(())
    }

    /// Ends the lease, so that others take over at once.
    ///
    /// # Errors
    /// If the database cannot be written.
    pub async fn leave(&self) -> Result<(), FleetError> {
        self.current().leave().await
    }
}
