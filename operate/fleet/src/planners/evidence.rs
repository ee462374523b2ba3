//! Live evidence: sums of traversals to which every planner adds. When an edge has many, all are halved, as
//! [`LiveEvidence`] does, so that recent ones can change the estimate.

use super::db::{Note, PlannerDb};
use super::receipts;
use crate::error::FleetError;
use std::collections::BTreeMap;
use surefoot_planner::live::{Counts, LiveEvidence, MEMORY, Reporter};
use surefoot_planner::store::Call;
use surefoot_planner::{EdgeKey, GraphId};
use surefoot_planner_service::replicas::Report;

/// Numbers of tries and sums of decisions, as in [`Counts`].
type Sums = ([i64; 3], [f64; 2]);

/// Rows, as columns.
#[derive(Default)]
struct Columns {
    reporters: Vec<String>,
    trusted: Vec<bool>,
    from: Vec<i32>,
    to: Vec<i32>,
    numbers: [Vec<i64>; 3],
    decisions: [Vec<f64>; 2],
}

impl Columns {
    /// Sums up by reporter and edge, in order, so that planners lock rows in the same order.
    fn of<'a>(counts: impl Iterator<Item = &'a Counts>) -> Self {
        let mut sums: BTreeMap<(EdgeKey, &Reporter), Sums> = BTreeMap::new();
        for Counts { reporter, edge, tries, decisions } in counts {
            let (numbers, sum) = sums.entry((*edge, reporter)).or_default();
            (0..3).for_each(|idx| numbers[idx] += i64::from(tries[idx]));
            (0..2).for_each(|idx| sum[idx] += decisions[idx]);
        }
        let mut columns = Self::default();
        for ((edge, reporter), (numbers, decisions)) in sums {
            columns.reporters.push(reporter.name.clone());
            columns.trusted.push(reporter.is_trusted);
            columns.from.push(edge.from.0 as i32);
            columns.to.push(edge.to.0 as i32);
            (0..3).for_each(|idx| columns.numbers[idx].push(numbers[idx]));
            (0..2).for_each(|idx| columns.decisions[idx].push(decisions[idx]));
        }
        columns
    }
}

/// Evidence of a deleted graph is dropped.
pub async fn add(db: &PlannerDb, graph: &GraphId, reports: &[Report]) -> Result<(), FleetError> {
    let mut transaction = db.begin().await?;
    // The lock permits one planner at a time to add and halve.
    let row = sqlx::query!("SELECT token FROM graphs WHERE id = $1 FOR UPDATE", &graph.0[..]);
    if row.fetch_optional(&mut *transaction).await?.is_none() {
        return Ok(transaction.rollback().await?);
    }
    let all: Vec<_> = reports.iter().map(|report| &report.receipt).collect();
    let new = receipts::store(&mut transaction, &all).await?;
    let is_new = |report: &&Report| {
        let Call { client, id, .. } = &report.receipt.call;
        new.contains(&(client.clone(), id.clone()))
    };
    let counts = reports.iter().filter(is_new).flat_map(|report| &report.counts);
    let Columns { reporters, trusted, from, to, numbers: [tries, successes, deaths], decisions: [sums, squares] } =
        Columns::of(counts);
    let added = sqlx::query!(
        "INSERT INTO evidence (graph, reporter, is_trusted, from_vertex, to_vertex, tries, successes, deaths, decisions,
             decisions_squared)
         SELECT $1, * FROM UNNEST($2::text[], $3::boolean[], $4::integer[], $5::integer[], $6::bigint[], $7::bigint[],
             $8::bigint[], $9::double precision[], $10::double precision[])
         ON CONFLICT (graph, from_vertex, to_vertex, is_trusted, reporter) DO UPDATE SET
             tries = evidence.tries + excluded.tries, successes = evidence.successes + excluded.successes,
             deaths = evidence.deaths + excluded.deaths, decisions = evidence.decisions + excluded.decisions,
             decisions_squared = evidence.decisions_squared + excluded.decisions_squared",
        &graph.0[..],
        &reporters,
        &trusted,
        &from,
        &to,
        &tries,
        &successes,
        &deaths,
        &sums,
        &squares,
    );
    added.execute(&mut *transaction).await?;
    loop {
        let halved = sqlx::query!(
            "UPDATE evidence SET
                 tries = successes / 2 + (evidence.tries - successes) / 2, successes = successes / 2, deaths = deaths / 2,
                 decisions = decisions * (successes / 2) / greatest(successes, 1),
                 decisions_squared = decisions_squared * (successes / 2) / greatest(successes, 1)
             FROM (SELECT is_trusted AS of_trusted, from_vertex AS leaves, to_vertex AS reaches FROM evidence
                   WHERE graph = $1 AND from_vertex = ANY($2)
                   GROUP BY 1, 2, 3 HAVING sum(tries)::bigint >= $3) AS many
             WHERE graph = $1 AND is_trusted = of_trusted AND from_vertex = leaves AND to_vertex = reaches",
            &graph.0[..],
            &from,
            i64::from(MEMORY),
        );
        if halved.execute(&mut *transaction).await?.rows_affected() == 0 {
            break;
        }
    }
    db.notify(&mut transaction, &Note::Evidence(*graph)).await?;
    Ok(transaction.commit().await?)
}

pub async fn drop_of(db: &PlannerDb, graph: &GraphId, name: &str) -> Result<(), FleetError> {
    let mut transaction = db.begin().await?;
    let dropped = sqlx::query!("DELETE FROM evidence WHERE graph = $1 AND reporter = $2", &graph.0[..], name);
    dropped.execute(&mut *transaction).await?;
    db.notify(&mut transaction, &Note::Evidence(*graph)).await?;
    Ok(transaction.commit().await?)
}

pub async fn read(db: &PlannerDb, graph: &GraphId) -> Result<LiveEvidence, FleetError> {
    let rows = sqlx::query!(
        "SELECT reporter, is_trusted, from_vertex, to_vertex, tries, successes, deaths, decisions, decisions_squared
         FROM evidence WHERE graph = $1 ORDER BY is_trusted, reporter, from_vertex, to_vertex",
        &graph.0[..],
    );
    let rows = rows.fetch_all(&db.database.pool).await?;
    let counts = rows.into_iter().map(|row| Counts {
        reporter: Reporter { name: row.reporter, is_trusted: row.is_trusted },
        edge: EdgeKey::new(row.from_vertex as u32, row.to_vertex as u32),
        tries: [row.tries, row.successes, row.deaths].map(|count| u32::try_from(count).unwrap_or(u32::MAX)),
        decisions: [row.decisions, row.decisions_squared],
    });
    Ok(LiveEvidence::of_counts(counts))
}
