//! Rows of worlds. Every call is a single statement, which commits by itself: a process that is stopped holds no lock.

use crate::blobs::BlobId;
use crate::database::Database;
use crate::error::FleetError;
use crate::membership::Membership;
use crate::notifications;
use std::collections::{BTreeMap, BTreeSet};
use surefoot_server::WorldId;
use surefoot_server::hosted::Journal;
use surefoot_server::store::ServerInfo;

/// Channel on which servers that leave notify the others.
pub const CHANNEL: &str = "surefoot_servers";

/// The right of a server to a world.
#[derive(Debug, Clone, Copy)]
pub struct Ownership {
    /// Member id of the server.
    pub member: i64,
    /// Fencing token.
    pub token: i64,
}

/// Returns the ownership of a new world.
pub async fn new_claim(database: &Database, member: i64) -> Result<Ownership, FleetError> {
    let token = sqlx::query_scalar!(r#"SELECT nextval('tokens') AS "token!""#).fetch_one(&database.pool).await?;
    Ok(Ownership { member, token })
}

/// Returns an id that no world has had.
pub async fn new_id(database: &Database, earliest: WorldId) -> Result<WorldId, FleetError> {
    let id =
        sqlx::query_scalar!("UPDATE world_ids SET last = greatest(last + 1, $1) RETURNING last", earliest.0 as i64);
    let id = id.fetch_one(&database.pool).await?;
    Ok(WorldId(id as u64))
}

/// Adds a world. Returns false if the lease of its server has expired.
pub async fn insert(
    database: &Database,
    id: WorldId,
    claim: Ownership,
    blob: BlobId,
    through: u64,
) -> Result<bool, FleetError> {
    let inserted = sqlx::query!(
        "INSERT INTO worlds (id, owner, token, blob, through, saved_at)
         SELECT $1, id, $3, $4, $5, now() FROM members WHERE id = $2 AND expires_at > now()
         ON CONFLICT (id) DO NOTHING",
        id.0 as i64,
        claim.member,
        claim.token,
        &blob.0,
        through as i64,
    );
    let inserted = inserted.execute(&database.pool).await?;
    Ok(inserted.rows_affected() == 1)
}

/// Points the row of a world to a new save, and removes the events that the save contains. Returns false if another
/// server owns the world, or the lease has expired.
pub async fn save(
    database: &Database,
    id: WorldId,
    claim: Ownership,
    blob: BlobId,
    through: u64,
) -> Result<bool, FleetError> {
    let saved = sqlx::query!(
        r#"WITH saved AS (
             UPDATE worlds SET blob = $4, through = $5, saved_at = now() FROM members
             WHERE worlds.id = $1 AND owner = $2 AND token = $3 AND members.id = owner AND expires_at > now()
             RETURNING worlds.id
         ), cleared AS (
             DELETE FROM world_events USING saved WHERE world = saved.id AND world_events.through <= $5
         )
         SELECT id FROM saved"#,
        id.0 as i64,
        claim.member,
        claim.token,
        &blob.0,
        through as i64,
    );
    let saved = saved.fetch_optional(&database.pool).await?;
    Ok(saved.is_some())
}

/// Removes a world. Returns false if another server owns it, or the lease has expired.
pub async fn forget(database: &Database, id: WorldId, claim: Ownership) -> Result<bool, FleetError> {
    let removed = sqlx::query!(
        "DELETE FROM worlds USING members
         WHERE worlds.id = $1 AND owner = $2 AND token = $3 AND members.id = owner AND expires_at > now()",
        id.0 as i64,
        claim.member,
        claim.token,
    );
    let removed = removed.execute(&database.pool).await?;
    Ok(removed.rows_affected() == 1)
}

/// Takes over worlds whose servers are gone: the share of this member, plus worlds that no server has taken for the
/// length of a lease, so that worlds find a server although others are full. The member has at most `max_worlds` then.
///
/// Also returns worlds that the member owns by a token up to `horizon`, such as after a claim whose answer was lost.
/// Worlds in `held` are skipped.
pub async fn claim(
    database: &Database,
    membership: &Membership,
    max_worlds: usize,
    (held, horizon): (&[WorldId], i64),
) -> Result<Vec<(WorldId, Ownership, BlobId)>, FleetError> {
    let (member, lease) = (membership.id(), membership.lease().as_secs_f64());
    let held: Vec<i64> = held.iter().map(|id| id.0 as i64).collect();
    // All get new tokens, so that pending writes with earlier ones fail, such as saves. Rows that get another owner
    // meanwhile are skipped.
    let claimed = sqlx::query!(
        r#"WITH own AS (SELECT count(*) AS count FROM worlds WHERE owner = $1),
         living AS (SELECT count(*) AS count FROM members WHERE kind = 'server' AND expires_at > now()),
         share AS (
             SELECT (SELECT count(*) FROM worlds) / greatest(living.count, 1) + 1 - own.count AS count FROM living, own
         ),
         overdue AS (
             SELECT count(*) AS count FROM worlds JOIN members ON members.id = owner
             WHERE expires_at <= now() - make_interval(secs => $3) AND NOT worlds.id = ANY($4)
         ),
         locked AS (
             SELECT worlds.id, owner FROM worlds JOIN members ON members.id = owner
             WHERE expires_at <= now() AND NOT worlds.id = ANY($4) ORDER BY expires_at, worlds.id
             LIMIT (SELECT greatest(least($2 - own.count, greatest(share.count, overdue.count)), 0)
                    FROM own, share, overdue)
             FOR UPDATE OF worlds SKIP LOCKED
         ),
         adrift AS (
             SELECT worlds.id, owner FROM worlds WHERE owner = $1 AND token <= $5 AND NOT worlds.id = ANY($4)
             FOR UPDATE SKIP LOCKED
         ),
         picked AS (SELECT id, owner FROM locked UNION SELECT id, owner FROM adrift)
         UPDATE worlds SET owner = $1, token = nextval('tokens') FROM picked
         WHERE worlds.id = picked.id AND worlds.owner = picked.owner
             AND EXISTS (SELECT FROM members WHERE id = $1 AND expires_at > now())
         RETURNING worlds.id, token, blob"#,
        member,
        i64::try_from(max_worlds).unwrap_or(i64::MAX),
        lease,
        &held,
        horizon,
    );
    let claimed = claimed.fetch_all(&database.pool).await?;
    let claimed = claimed.into_iter().map(|row| {
        let claim = Ownership { member, token: row.token };
        (WorldId(row.id as u64), claim, BlobId::of_row(&row.blob))
    });
    Ok(claimed.collect())
}

/// Returns the latest token of any claim.
pub async fn last_token(database: &Database) -> Result<i64, FleetError> {
    Ok(sqlx::query_scalar!("SELECT last_value FROM tokens").fetch_one(&database.pool).await?)
}

/// Makes a world ownerless, so that any server may take it over. Returns false if another server owns it, or the lease
/// has expired.
pub async fn hand_back(database: &Database, id: WorldId, claim: Ownership) -> Result<bool, FleetError> {
    let handed = sqlx::query!(
        "UPDATE worlds SET owner = (SELECT id FROM members WHERE expires_at = '-infinity' LIMIT 1) FROM members
         WHERE worlds.id = $1 AND owner = $2 AND token = $3 AND members.id = owner AND expires_at > now()",
        id.0 as i64,
        claim.member,
        claim.token,
    );
    let handed = handed.execute(&database.pool).await?;
    Ok(handed.rows_affected() == 1)
}

/// Appends journals. Returns for each world whether the server still owns it, so that its journal is stored.
pub async fn append(
    database: &Database,
    journals: Vec<(WorldId, Ownership, &Journal)>,
) -> Result<BTreeMap<WorldId, bool>, FleetError> {
    let column = |of: fn(&(WorldId, Ownership, &Journal)) -> i64| journals.iter().map(of).collect::<Vec<_>>();
    let ids = column(|(id, ..)| id.0 as i64);
    let owners = column(|(_, claim, _)| claim.member);
    let tokens = column(|(_, claim, _)| claim.token);
    let throughs = column(|(_, _, journal)| journal.through as i64);
    let events: Vec<Vec<u8>> = journals.iter().map(|(_, _, journal)| journal.encode()).collect();
    // A takeover waits for this lock, or skips the world until the events are stored. After a takeover, the token
    // differs.
    let appended = sqlx::query_scalar!(
        r#"WITH given AS (
             SELECT * FROM unnest($1::bigint[], $2::bigint[], $3::bigint[], $4::bigint[], $5::bytea[])
                 AS given (world, owner, token, through, events)
         ), own AS (
             SELECT given.world, given.through, given.events FROM worlds
             JOIN given ON worlds.id = given.world AND worlds.owner = given.owner AND worlds.token = given.token
             JOIN members ON members.id = worlds.owner AND expires_at > now()
             ORDER BY worlds.id FOR UPDATE OF worlds
         )
         INSERT INTO world_events (world, through, events) SELECT world, through, events FROM own
         ON CONFLICT (world, through) DO UPDATE SET events = excluded.events
         RETURNING world"#,
        &ids,
        &owners,
        &tokens,
        &throughs,
        &events,
    );
    let mut call = database.urgent().await?;
    let appended = appended.fetch_all(call.connection()).await;
    let appended = call.done(appended)?;
    Ok(journals.iter().map(|(id, ..)| (*id, appended.contains(&(id.0 as i64)))).collect())
}

/// Returns the journals since the last save of a world, in order.
pub async fn journals(database: &Database, id: WorldId) -> Result<Vec<(u64, Vec<u8>)>, FleetError> {
    let rows = sqlx::query!(
        "SELECT world_events.through, events FROM world_events JOIN worlds ON worlds.id = world
         WHERE world = $1 AND world_events.through > worlds.through ORDER BY world_events.through",
        id.0 as i64,
    );
    let rows = rows.fetch_all(&database.pool).await?;
    Ok(rows.into_iter().map(|row| (row.through as u64, row.events)).collect())
}

/// Returns where worlds run, as the member `own` sees it. Worlds that do not exist are left out.
pub async fn locate(
    database: &Database,
    ids: &BTreeSet<WorldId>,
    own: i64,
) -> Result<BTreeMap<WorldId, ServerInfo>, FleetError> {
    let ids: Vec<i64> = ids.iter().map(|id| id.0 as i64).collect();
    let rows = sqlx::query!(
        r#"SELECT worlds.id, members.id AS member, address, expires_at > now() AS "is_alive!",
               (SELECT count(*) FROM worlds WHERE owner = members.id) AS "world_count!"
         FROM worlds JOIN members ON members.id = owner WHERE worlds.id = ANY($1)"#,
        &ids,
    );
    let rows = rows.fetch_all(&database.lookups).await?;
    let place = |is_here, address, is_alive, world_count| ServerInfo { address, is_here, is_alive, world_count };
    let found = rows.into_iter().map(|row| {
        (WorldId(row.id as u64), place(row.member == own, row.address, row.is_alive, row.world_count as u64))
    });
    Ok(found.collect())
}

/// Returns all servers that hold their lease, by address.
pub async fn servers(database: &Database, own: i64) -> Result<Vec<ServerInfo>, FleetError> {
    let rows = sqlx::query!(
        r#"SELECT id, address, (SELECT count(*) FROM worlds WHERE owner = members.id) AS "world_count!"
         FROM members WHERE kind = 'server' AND expires_at > now() ORDER BY address, id"#,
    );
    let rows = rows.fetch_all(&database.lookups).await?;
    let place = |id: i64, address, world_count: i64| ServerInfo {
        address,
        is_here: id == own,
        is_alive: true,
        world_count: world_count as u64,
    };
    Ok(rows.into_iter().map(|row| place(row.id, row.address, row.world_count)).collect())
}

/// Returns all worlds and the blobs of their last saves. For measurements.
pub async fn saves(database: &Database) -> Result<Vec<(WorldId, BlobId)>, FleetError> {
    let rows = sqlx::query!("SELECT id, blob FROM worlds ORDER BY id").fetch_all(&database.pool).await?;
    Ok(rows.into_iter().map(|row| (WorldId(row.id as u64), BlobId::of_row(&row.blob))).collect())
}

/// Notifies all servers to look for worlds.
pub async fn notify(database: &Database) -> Result<(), FleetError> {
    let mut connection = database.pool.acquire().await?;
    Ok(notifications::notify(&mut connection, CHANNEL, "").await?)
}
