//! Receipts of calls that clients may repeat. A receipt is stored in the transaction that carries out its call, so
//! that a repeat on any planner is not carried out again.

use super::db::PlannerDb;
use crate::error::FleetError;
use sqlx::PgConnection;
use std::collections::BTreeSet;
use surefoot_planner::store::{Call, MAX_RECEIPTS, RECEIPTS_KEPT_FOR, Receipt};

/// An expired receipt counts until it is removed, since it blocks its id until then.
pub async fn find(db: &PlannerDb, client: &str, id: &str) -> Result<Option<Receipt>, FleetError> {
    let row = sqlx::query!("SELECT request, answer FROM receipts WHERE client = $1 AND request_id = $2", client, id);
    let row = row.fetch_optional(&db.database.pool).await?;
    Ok(row.map(|row| {
        let request = row.request.try_into().expect("the table has hashes of 32 bytes only");
        let call = Call { client: client.to_owned(), id: id.to_owned(), request };
        Receipt { call, answer: row.answer }
    }))
}

/// Stores receipts in the transaction of `connection`. Returns the calls that had none. It waits for transactions that
/// carry out the same calls.
pub async fn store(
    connection: &mut PgConnection,
    receipts: &[&Receipt],
) -> Result<BTreeSet<(String, String)>, FleetError> {
    let (mut clients, mut ids, mut requests, mut answers) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    for Receipt { call: Call { client, id, request }, answer } in receipts {
        clients.push(client.clone());
        ids.push(id.clone());
        requests.push(request.to_vec());
        answers.push(answer.clone());
    }
    let stored = sqlx::query!(
        "INSERT INTO receipts (client, request_id, request, answer)
         SELECT * FROM UNNEST($1::text[], $2::text[], $3::bytea[], $4::bytea[])
         ON CONFLICT DO NOTHING RETURNING client, request_id",
        &clients,
        &ids,
        &requests,
        &answers,
    );
    let stored = stored.fetch_all(&mut *connection).await?;
    for client in BTreeSet::from_iter(clients) {
        let surplus = sqlx::query!(
            "DELETE FROM receipts WHERE client = $1 AND noted_at <=
                 (SELECT noted_at FROM receipts WHERE client = $1 ORDER BY noted_at DESC OFFSET $2 LIMIT 1)",
            client,
            MAX_RECEIPTS as i64,
        );
        surplus.execute(&mut *connection).await?;
    }
    Ok(stored.into_iter().map(|row| (row.client, row.request_id)).collect())
}

/// Deletes receipts that are too old.
pub async fn forget(db: &PlannerDb) -> Result<(), FleetError> {
    let old = sqlx::query!(
        "DELETE FROM receipts WHERE noted_at < now() - make_interval(secs => $1)",
        RECEIPTS_KEPT_FOR.as_secs_f64()
    );
    Ok(old.execute(&db.database.pool).await.map(drop)?)
}
