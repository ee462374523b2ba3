//! Imported levels: a row with name and owner, a blob with the map.

use super::db::{BLOB_PATIENCE, PlannerDb};
use crate::blobs::BlobId;
use std::sync::Arc;
use surefoot_net::levels::{LevelArchive, SavedLevel};
use surefoot_planner::store::StoreErrorKind;
use tracing::warn;

/// The levels of all planners.
#[derive(Debug)]
pub struct Levels(pub Arc<PlannerDb>);

impl LevelArchive for Levels {
    fn save(&self, SavedLevel { map_hash, name, owner, file }: SavedLevel) -> Result<(), String> {
        let Self(db) = self;
        let hash: BlobId = map_hash.parse()?;
        let saved = db.block_for(BLOB_PATIENCE, async {
            let blob = db.blobs.put(file).await?;
            let saved = sqlx::query!(
                "INSERT INTO levels (map_hash, name, owner, blob) VALUES ($1, $2, $3, $4)
                 ON CONFLICT (map_hash) DO UPDATE SET name = excluded.name, owner = excluded.owner, blob = excluded.blob",
                &hash.0[..],
                name,
                owner,
                &blob.0[..],
            );
            Ok(saved.execute(&db.database.pool).await.map(drop)?)
        });
        saved.map_err(|error| error.to_string())
    }

    fn load(&self, map_hash: &str) -> Result<Option<SavedLevel>, String> {
        let Self(db) = self;
        // A text that is not a hash names no level.
        let Ok(hash) = map_hash.parse::<BlobId>() else { return Ok(None) };
        let found = db.block_for(BLOB_PATIENCE, async {
            let row = sqlx::query!("SELECT name, owner, blob FROM levels WHERE map_hash = $1", &hash.0[..]);
            let row = row.fetch_optional(&db.database.pool).await?;
            let Some(row) = row else { return Ok(None) };
            let blob = BlobId::of_row(&row.blob);
            let file = match db.blobs.get(blob).await {
                Ok(Some(file)) => file,
                Err(error) if error.kind != StoreErrorKind::Lost => return Err(error),
                // Importing the same file stores the blob again.
                Ok(None) | Err(_) => {
                    warn!(level = row.name, %blob, "planner: the blob of a level is lost; import the level again");
                    return Ok(None);
                }
            };
            Ok(Some(SavedLevel { map_hash: map_hash.to_owned(), name: row.name, owner: row.owner, file }))
        });
        found.map_err(|error| error.to_string())
    }
}
