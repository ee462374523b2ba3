//! Layers of designers. A change is stored only if the layers have the version for which it was made.

use super::db::{Note, PLACE, PlannerDb, signed, unsigned};
use super::receipts;
use crate::error::FleetError;
use surefoot_planner::edits::Layer;
use surefoot_planner::store::{DamagedLayer, LevelId, LevelLayers, Receipt, decode_layer, encode_layer};

pub async fn read(db: &PlannerDb, level: &LevelId) -> Result<LevelLayers, FleetError> {
    // One statement reads version and layers at the same time.
    let rows = sqlx::query!(
        r#"SELECT version, name AS "name?", content AS "content?" FROM level_versions LEFT JOIN layers USING (level)
           WHERE level = $1"#,
        &level.0[..],
    );
    let rows = rows.fetch_all(&db.database.pool).await?;
    let mut found = LevelLayers::default();
    for row in rows {
        found.version = unsigned(row.version);
        let (Some(name), Some(content)) = (row.name, row.content) else { continue };
        match decode_layer(&content) {
            Ok(layer) => found.layers.push(layer),
            Err(reason) => found.damaged.push(DamagedLayer { name, place: PLACE.to_owned(), reason }),
        }
    }
    found.layers.sort_by(|a, b| a.name.cmp(&b.name));
    found.damaged.sort_by(|a, b| a.name.cmp(&b.name));
    Ok(found)
}

pub async fn replace(
    db: &PlannerDb,
    level: &LevelId,
    version: u64,
    layer: &Layer,
    receipt: Option<&Receipt>,
) -> Result<bool, FleetError> {
    let (level_bytes, content) = (&level.0[..], encode_layer(layer));
    let mut transaction = db.begin().await?;
    let begun =
        sqlx::query!("INSERT INTO level_versions (level, version) VALUES ($1, 0) ON CONFLICT DO NOTHING", level_bytes);
    begun.execute(&mut *transaction).await?;
    let counted = sqlx::query!(
        "UPDATE level_versions SET version = version + 1 WHERE level = $1 AND version = $2",
        level_bytes,
        signed(version),
    );
    if counted.execute(&mut *transaction).await?.rows_affected() == 0 {
        transaction.rollback().await?;
        return Ok(false);
    }
    if let Some(receipt) = receipt
        && receipts::store(&mut transaction, &[receipt]).await?.is_empty()
    {
        transaction.rollback().await?;
        return Ok(false);
    }
    if layer.edits.is_empty() {
        let removed = sqlx::query!("DELETE FROM layers WHERE level = $1 AND name = $2", level_bytes, layer.name);
        removed.execute(&mut *transaction).await?;
    } else {
        let stored = sqlx::query!(
            "INSERT INTO layers (level, name, content) VALUES ($1, $2, $3)
             ON CONFLICT (level, name) DO UPDATE SET content = excluded.content",
            level_bytes,
            layer.name,
            content,
        );
        stored.execute(&mut *transaction).await?;
    }
    db.notify(&mut transaction, &Note::Layers(*level)).await?;
    transaction.commit().await?;
    Ok(true)
}
