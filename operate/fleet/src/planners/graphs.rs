//! Graphs: claims of their builds, and publishing, which checks the claim and the lease in the transaction that stores
//! the graph.

use super::db::{BLOB_PATIENCE, Note, PlannerDb, unsigned};
use super::operations::phase_of;
use crate::blobs::BlobId;
use crate::error::{DATABASE, FleetError};
use std::sync::atomic::Ordering;
use surefoot_planner::store::{StoreError, StoreErrorKind, decode_entry, encode_entry};
use surefoot_planner::{BuildStats, Built, GraphId};
use surefoot_planner_service::replicas::{BuildStatus, ClaimOutcome, Token};
use surefoot_planner_service::{BuildId, failpoint};
use tracing::warn;

pub async fn get(db: &PlannerDb, id: &GraphId) -> Result<Option<Built>, FleetError> {
    let row = sqlx::query!(
        r#"UPDATE graphs SET used_at = now() WHERE id = $1 AND blob IS NOT NULL RETURNING blob AS "blob!", times"#,
        &id.0[..],
    );
    let row = row.fetch_optional(&db.database.pool).await?;
    let Some(row) = row else { return Ok(None) };
    let blob = BlobId::of_row(&row.blob);
    let decoded = match db.blobs.get(blob).await {
        Ok(Some(bytes)) => decode_entry(&bytes),
        Ok(None) => Err("there is no such blob".to_owned()),
        Err(error) if error.kind == StoreErrorKind::Lost => Err(error.reason),
        Err(error) => return Err(error),
    };
    let Built { graph, stats } = match decoded {
        Ok(built) => built,
        Err(reason) => {
            warn!(graph = %id, %blob, reason, "planner: the blob of a graph is lost; the graph is built again");
            return forget_blob(db, id, blob).await.map(|()| None);
        }
    };
    let [placing_s, probing_s, seconds] = row.times[..] else { return Ok(Some(Built { graph, stats })) };
    Ok(Some(Built { graph, stats: BuildStats { placing_s, probing_s, seconds, ..stats } }))
}

/// Notes that a graph has no blob, unless it has a new one. Its recipe and evidence stay.
async fn forget_blob(db: &PlannerDb, graph: &GraphId, BlobId(blob): BlobId) -> Result<(), FleetError> {
    let forgotten = sqlx::query!("UPDATE graphs SET blob = NULL WHERE id = $1 AND blob = $2", &graph.0[..], &blob[..]);
    Ok(forgotten.execute(&db.database.pool).await.map(drop)?)
}

pub fn claim(db: &PlannerDb, graph: &GraphId, build: BuildId) -> Result<ClaimOutcome, StoreError> {
    db.building.lock().insert(graph.0);
    let claimed = db.block(async {
        match try_claim(db, graph, build).await? {
            Some(claim) => Ok(claim),
            None => {
                db.renew_lease().await?;
                let dead = || FleetError::new(DATABASE, "the lease of this planner has expired");
                try_claim(db, graph, build).await?.ok_or_else(dead)
            }
        }
    });
    if !matches!(claimed, Ok(ClaimOutcome::Ours(_))) {
        db.building.lock().remove(&graph.0);
    }
    claimed
}

/// Returns `None` if the lease of this planner has expired.
async fn try_claim(db: &PlannerDb, graph: &GraphId, build: BuildId) -> Result<Option<ClaimOutcome>, FleetError> {
    let member = db.membership.id();
    let mut transaction = db.begin().await?;
    let token = sqlx::query_scalar!(
        "INSERT INTO claims (graph, member, token, build)
         SELECT $1, id, nextval('tokens'), $3 FROM members WHERE id = $2 AND expires_at > now()
         ON CONFLICT (graph) DO UPDATE SET member = excluded.member, token = excluded.token, build = excluded.build
         WHERE claims.member = excluded.member
            OR NOT EXISTS (SELECT FROM members WHERE id = claims.member AND expires_at > now())
         RETURNING token",
        &graph.0[..],
        member,
        build.bits() as i64,
    );
    let token = token.fetch_optional(&mut *transaction).await?;
    let found = sqlx::query!(
        r#"SELECT EXISTS (SELECT FROM graphs WHERE id = $1 AND blob IS NOT NULL) AS "is_published!",
                  EXISTS (SELECT FROM members WHERE id = $2 AND expires_at > now()) AS "lives!""#,
        &graph.0[..],
        member,
    );
    let found = found.fetch_one(&mut *transaction).await?;
    if found.is_published {
        // The claim is not needed.
        transaction.rollback().await?;
        return Ok(Some(ClaimOutcome::Published));
    }
    if let Some(token) = token {
        transaction.commit().await?;
        return Ok(Some(ClaimOutcome::Ours(Token(token))));
    }
    if !found.lives {
        return Ok(None);
    }
    let posted = sqlx::query!(
        "SELECT stage, probes_done, probes_total FROM claims JOIN operations ON operations.id = claims.build
         WHERE claims.graph = $1",
        &graph.0[..],
    );
    let posted = posted.fetch_optional(&mut *transaction).await?;
    Ok(Some(ClaimOutcome::Theirs(posted.map(|row| BuildStatus {
        phase: phase_of(row.stage),
        done: unsigned(row.probes_done),
        total: unsigned(row.probes_total),
    }))))
}

/// If this fails, [`sweep`] releases the claim.
pub fn release(db: &PlannerDb, graph: &GraphId) {
    db.building.lock().remove(&graph.0);
    let released = db.block(async {
        let mut transaction = db.begin().await?;
        let gone =
            sqlx::query!("DELETE FROM claims WHERE graph = $1 AND member = $2", &graph.0[..], db.membership.id());
        if gone.execute(&mut *transaction).await?.rows_affected() > 0 {
            db.notify(&mut transaction, &Note::Graph(*graph)).await?;
        }
        Ok(transaction.commit().await?)
    });
    if let Err(error) = released {
        warn!(%error, %graph, "planner: cannot release the claim of a build yet");
    }
}

/// Removes claims of this planner for which it does not build, and those of planners that have died.
pub async fn sweep(db: &PlannerDb) -> Result<(), FleetError> {
    let newest =
        sqlx::query_scalar!(r#"SELECT CASE WHEN is_called THEN last_value ELSE 0 END AS "newest!" FROM tokens"#);
    let newest = newest.fetch_one(&db.database.pool).await?;
    // `building` contains every claim up to this token: a build is added before its claim gets a token. Later claims
    // are kept.
    let building: Vec<Vec<u8>> = db.building.lock().iter().map(|id| id.to_vec()).collect();
    let gone = sqlx::query!(
        "DELETE FROM claims WHERE (member = $1 AND token <= $3 AND NOT graph = ANY($2))
            OR NOT EXISTS (SELECT FROM members WHERE members.id = claims.member AND expires_at > now())",
        db.membership.id(),
        &building,
        newest,
    );
    Ok(gone.execute(&db.database.pool).await.map(drop)?)
}

pub fn publish(
    db: &PlannerDb,
    graph: &GraphId,
    Token(token): Token,
    recipe: &[u8],
    Built { graph: nav, stats }: &Built,
) -> Result<bool, StoreError> {
    // Without times, every builder gets the same bytes.
    let times = [stats.placing_s, stats.probing_s, stats.seconds];
    let timeless = BuildStats { placing_s: 0.0, probing_s: 0.0, seconds: 0.0, ..*stats };
    let bytes = encode_entry(&Built { graph: nav.clone(), stats: timeless });
    let blob = db.block_for(BLOB_PATIENCE, db.blobs.put(bytes))?;
    failpoint("stored");
    let is_published = db.block(async {
        let mut transaction = db.begin().await?;
        // The lock keeps the claim from being taken over. The lease is checked after the lock, which may take long.
        let locked = sqlx::query!("SELECT token FROM claims WHERE graph = $1 FOR UPDATE", &graph.0[..]);
        locked.fetch_optional(&mut *transaction).await?;
        let holds = sqlx::query_scalar!(
            r#"SELECT true AS "holds!" FROM claims JOIN members ON members.id = claims.member
               WHERE claims.graph = $1 AND claims.token = $2 AND members.expires_at > clock_timestamp()
               FOR UPDATE OF members"#,
            &graph.0[..],
            token,
        );
        if holds.fetch_optional(&mut *transaction).await?.is_none() {
            transaction.rollback().await?;
            return Ok(false);
        }
        let stored = sqlx::query!(
            "INSERT INTO graphs (id, recipe, blob, times, token) VALUES ($1, $2, $3, $4, $5)
             ON CONFLICT (id) DO UPDATE SET recipe = excluded.recipe, blob = excluded.blob, times = excluded.times,
                 token = excluded.token
             WHERE graphs.blob IS NULL",
            &graph.0[..],
            recipe,
            &blob.0[..],
            &times[..],
            token,
        );
        stored.execute(&mut *transaction).await?;
        let done = sqlx::query!("DELETE FROM claims WHERE graph = $1", &graph.0[..]);
        done.execute(&mut *transaction).await?;
        db.notify(&mut transaction, &Note::Graph(*graph)).await?;
        transaction.commit().await?;
        Ok(true)
    })?;
    if is_published {
        failpoint("published");
    } else {
        db.stale_publishes.fetch_add(1, Ordering::Relaxed);
        warn!(%graph, "planner: its lease expired during a build; the graph is not published");
    }
    Ok(is_published)
}

pub async fn recipe(db: &PlannerDb, graph: &GraphId) -> Result<Option<Vec<u8>>, FleetError> {
    let found = sqlx::query_scalar!("SELECT recipe FROM graphs WHERE id = $1", &graph.0[..]);
    Ok(found.fetch_optional(&db.database.pool).await?)
}

pub async fn note_recipe(db: &PlannerDb, graph: &GraphId, recipe: &[u8]) -> Result<(), FleetError> {
    let noted = sqlx::query!(
        "INSERT INTO graphs (id, recipe, times, token) VALUES ($1, $2, '{}', 0) ON CONFLICT DO NOTHING",
        &graph.0[..],
        recipe,
    );
    Ok(noted.execute(&db.database.pool).await.map(drop)?)
}
