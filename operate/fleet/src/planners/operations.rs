//! Builds of all planners, as clients see them.

use super::db::{PlannerDb, signed, unsigned};
use crate::error::FleetError;
use std::time::{Duration, SystemTime};
use surefoot_planner::GraphId;
use surefoot_planner_service::replicas::{BuildStatus, Operation, Withdrawals};
use surefoot_planner_service::{BuildId, BuildPhase, Failure};

/// Maximum number of orphaned builds that are taken over at a time. Other planners take over the rest.
const ADOPTED_AT_A_TIME: i64 = 4;
/// Maximum number of builds of other planners that are listed.
const LISTED: i64 = 256;
/// Phases by their number in the database.
const PHASES: [BuildPhase; 8] = [
    BuildPhase::Queued,
    BuildPhase::Map,
    BuildPhase::Vertices,
    BuildPhase::Probes,
    BuildPhase::Index,
    BuildPhase::Done,
    BuildPhase::Failed,
    BuildPhase::Cancelled,
];

/// Returns the phase with this number.
pub fn phase_of(number: i16) -> BuildPhase {
    usize::try_from(number).ok().and_then(|idx| PHASES.get(idx)).copied().unwrap_or(BuildPhase::Failed)
}

fn number_of(phase: BuildPhase) -> i16 {
    PHASES.iter().position(|other| *other == phase).expect("all phases have a number") as i16
}

/// A row of the table.
struct Row {
    id: i64,
    recipe: Vec<u8>,
    member: i64,
    stage: i16,
    probes_done: i64,
    probes_total: i64,
    graph: Option<Vec<u8>>,
    reason: Option<String>,
    message: Option<String>,
    started: f64,
    requesters: Vec<String>,
    withdrawn: Vec<String>,
    is_cancelled: bool,
}

impl Row {
    fn read(self, own: i64) -> Operation {
        let failure = self.reason.zip(self.message).map(|(reason, message)| Failure { reason, message });
        let since = Duration::try_from_secs_f64(self.started).unwrap_or_default();
        Operation {
            id: BuildId::of_bits(unsigned(self.id)),
            recipe: self.recipe,
            status: BuildStatus {
                phase: phase_of(self.stage),
                done: unsigned(self.probes_done),
                total: unsigned(self.probes_total),
            },
            graph: self.graph.and_then(|id| id.try_into().ok()).map(GraphId),
            failure,
            requesters: self.requesters,
            withdrawals: Withdrawals { clients: self.withdrawn, is_cancelled: self.is_cancelled },
            started: SystemTime::UNIX_EPOCH + since,
            is_ours: self.member == own,
        }
    }
}

pub async fn post(db: &PlannerDb, operation: &Operation) -> Result<Withdrawals, FleetError> {
    let Operation {
        id, recipe, status: BuildStatus { phase, done, total }, graph, failure, requesters, started, ..
    } = operation;
    let since = started.duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default();
    // If another planner has taken the build over, its row is kept.
    let posted = sqlx::query!(
        "INSERT INTO operations (id, recipe, member, stage, probes_done, probes_total, graph, reason, message, started,
             requesters)
         VALUES ($1, $2, $3, $4, $5, $6, $7, $8, $9, $10, $11)
         ON CONFLICT (id) DO UPDATE SET
             member = excluded.member, stage = excluded.stage, probes_done = excluded.probes_done,
             probes_total = excluded.probes_total, graph = excluded.graph, reason = excluded.reason,
             message = excluded.message, requesters = excluded.requesters, noted_at = now()
         WHERE operations.member = excluded.member
            OR NOT EXISTS (SELECT FROM members WHERE id = operations.member AND expires_at > now())
         RETURNING withdrawn, is_cancelled",
        signed(id.bits()),
        recipe,
        db.membership.id(),
        number_of(*phase),
        signed(*done),
        signed(*total),
        graph.as_ref().map(|id| &id.0[..]),
        failure.as_ref().map(|failure| &failure.reason[..]),
        failure.as_ref().map(|failure| &failure.message[..]),
        since.as_secs_f64(),
        requesters,
    );
    let posted = posted.fetch_optional(&db.database.pool).await?;
    let asked = posted.map(|row| Withdrawals { clients: row.withdrawn, is_cancelled: row.is_cancelled });
    Ok(asked.unwrap_or_default())
}

pub async fn find(db: &PlannerDb, id: BuildId) -> Result<Option<Operation>, FleetError> {
    let found = sqlx::query_as!(
        Row,
        "SELECT id, recipe, member, stage, probes_done, probes_total, graph, reason, message, started,
             requesters, withdrawn, is_cancelled
         FROM operations WHERE id = $1",
        signed(id.bits()),
    );
    let found = found.fetch_optional(&db.database.pool).await?;
    Ok(found.map(|row| row.read(db.membership.id())))
}

pub async fn open(db: &PlannerDb) -> Result<Vec<Operation>, FleetError> {
    let open = sqlx::query_as!(
        Row,
        "SELECT id, recipe, member, stage, probes_done, probes_total, graph, reason, message, started,
             requesters, withdrawn, is_cancelled
         FROM operations WHERE stage < 5 ORDER BY id DESC LIMIT $1",
        LISTED,
    );
    let open = open.fetch_all(&db.database.pool).await?;
    Ok(open.into_iter().map(|row| row.read(db.membership.id())).collect())
}

pub async fn withdraw(db: &PlannerDb, id: BuildId, withdrawals: &Withdrawals) -> Result<(), FleetError> {
    let withdrawn = sqlx::query!(
        "UPDATE operations SET withdrawn = withdrawn || $2::text[], is_cancelled = is_cancelled OR $3 WHERE id = $1",
        signed(id.bits()),
        &withdrawals.clients,
        withdrawals.is_cancelled,
    );
    Ok(withdrawn.execute(&db.database.pool).await.map(drop)?)
}

pub async fn adopt(db: &PlannerDb) -> Result<Vec<Operation>, FleetError> {
    let own = db.membership.id();
    let adopted = sqlx::query_as!(
        Row,
        "UPDATE operations SET member = $1, noted_at = now() WHERE id IN (
             SELECT id FROM operations AS open WHERE stage < 5
                 AND NOT EXISTS (SELECT FROM members WHERE members.id = open.member AND expires_at > now())
             ORDER BY id LIMIT $2 FOR UPDATE SKIP LOCKED)
         RETURNING id, recipe, member, stage, probes_done, probes_total, graph, reason, message, started, requesters,
             withdrawn, is_cancelled",
        own,
        ADOPTED_AT_A_TIME,
    );
    let adopted = adopted.fetch_all(&db.database.pool).await?;
    Ok(adopted.into_iter().map(|row| row.read(own)).collect())
}

/// Deletes builds that ended more than ten minutes ago, and planners that died a day ago.
pub async fn forget(db: &PlannerDb) -> Result<(), FleetError> {
    let old = sqlx::query!("DELETE FROM operations WHERE stage >= 5 AND noted_at < now() - interval '10 minutes'");
    old.execute(&db.database.pool).await?;
    let dead = sqlx::query!("DELETE FROM members WHERE kind = 'planner' AND expires_at < now() - interval '1 day'");
    Ok(dead.execute(&db.database.pool).await.map(drop)?)
}
