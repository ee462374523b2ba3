//! The harness itself, and the crate's own parts on real engines.

use crate::relay::Relay;
use crate::services::{Ground, Postgres, S3};
use std::time::Duration;
use surefoot_fleet::blobs::{BlobId, Blobs};
use surefoot_fleet::database::Database;
use surefoot_fleet::membership::{MemberKind, Membership};
use surefoot_processes::wait_until;

/// A lease that is over soon.
const SHORT: Duration = Duration::from_millis(300);

#[tokio::test(flavor = "multi_thread")]
async fn a_member_that_was_silent_for_its_lease_stays_dead() {
    let ground = Ground::new();
    let mut postgres = Postgres::start(&ground);
    let relay = Relay::to(postgres.address);
    let database = Database::open(&Postgres::url_at(relay.address)).await.unwrap();
    let again = Database::open(&postgres.url()).await.unwrap();
    let member = Membership::join(&database, MemberKind::Planner, "http://127.0.0.1:1", SHORT).await.unwrap();
    let other =
        Membership::join(&again, MemberKind::Server, "http://127.0.0.1:2", Duration::from_secs(3600)).await.unwrap();
    assert!(member.holds_lease() && member.id() < other.id());
    assert!(member.renew().await.unwrap());
    relay.refuse();
    wait_until("the lease is over by its own clock", || async { !member.holds_lease() }).await;
    member.renew().await.expect_err("no way to the database");
    relay.mend();
    wait_until("the database says that its lease has expired", || async {
        member.renew().await.is_ok_and(|is_renewed| !is_renewed)
    })
    .await;
    assert!(!member.holds_lease());
    postgres.kill();
    other.renew().await.expect_err("there is no database");
    assert!(other.holds_lease(), "its lease is long");
    postgres.start_again();
    wait_until("it goes on", || async { other.renew().await.is_ok_and(|is_renewed| is_renewed) }).await;
    other.leave().await.unwrap();
    assert!(!other.renew().await.unwrap(), "it has left");
    assert_eq!(postgres.query("SELECT count(*) FROM members WHERE expires_at > now()"), ["0"]);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_database_that_cannot_be_opened_says_why() {
    let ground = Ground::new();
    let postgres = Postgres::start(&ground);
    let error = Database::open("mysql://nobody").await.unwrap_err().to_string();
    assert!(error.starts_with("--store: "), "{error}");
    let nowhere = Database::open("postgres://surefoot:secret@127.0.0.1:1/surefoot").await.unwrap_err().to_string();
    assert!(nowhere.starts_with("postgres://127.0.0.1:1/surefoot: ") && !nowhere.contains("secret"), "{nowhere}");
    Database::open(&postgres.url()).await.unwrap();
    postgres.query("INSERT INTO _sqlx_migrations VALUES (9999, 'of a newer version', now(), true, '', 0)");
    Database::open(&postgres.url()).await.expect("a schema that has grown serves this version too");
    postgres.query("UPDATE _sqlx_migrations SET checksum = 'x' WHERE version = 1");
    let other = Database::open(&postgres.url()).await.unwrap_err().to_string();
    assert!(other.contains("migration 1"), "{other}");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_role_that_may_not_change_tables_needs_the_migrations_first() {
    let ground = Ground::new();
    let postgres = Postgres::start_empty(&ground);
    let refused = async || Database::open(&postgres.url()).await.unwrap_err().to_string();
    let names_the_command = |error: &str, missing: &str| {
        assert!(error.contains(missing) && error.contains("run surefoot fleet migrate"), "{error}");
    };
    names_the_command(&refused().await, "lacks migration 1,");
    postgres.migrate();
    Database::open(&postgres.url()).await.unwrap();
    assert!(!postgres.refuses("DELETE FROM graphs"));
    for statement in ["CREATE TABLE more ()", "DROP TABLE graphs", "DELETE FROM _sqlx_migrations"] {
        assert!(postgres.refuses(statement), "{statement}");
    }

    // As an earlier version left it.
    postgres.query("DELETE FROM _sqlx_migrations WHERE version = 6");
    postgres.query("ALTER TABLE operations DROP COLUMN requesters, DROP COLUMN withdrawn");
    names_the_command(&refused().await, "lacks migration 6,");
    Database::open(&postgres.owner_url("surefoot")).await.expect("its role may change tables");
    Database::open(&postgres.url()).await.expect("the schema is up to date again");

    postgres.query("CREATE ROLE stranger LOGIN");
    let stranger = postgres.url().replace("surefoot@", "stranger@");
    let error = Database::open(&stranger).await.unwrap_err().to_string();
    names_the_command(&error, "permission denied for table _sqlx_migrations");
}

async fn blobs_keep_what_they_are_given(blobs: &Blobs) {
    let bytes: Vec<u8> = (0..2_000_000u32).map(|idx| (idx.wrapping_mul(idx) >> 7) as u8).collect();
    let id = blobs.put(bytes.clone()).await.unwrap();
    assert_eq!(id, BlobId::of(&bytes));
    assert_eq!(id.to_string().parse(), Ok(id));
    assert_eq!(blobs.put(bytes.clone()).await.unwrap(), id, "the same bytes again change nothing");
    assert_eq!(blobs.get(id).await.unwrap(), Some(bytes));
    assert_eq!(blobs.get(BlobId([7; 32])).await.unwrap(), None);
    blobs.remove(id).await.unwrap();
    blobs.remove(id).await.unwrap();
    assert_eq!(blobs.get(id).await.unwrap(), None);
}

#[tokio::test(flavor = "multi_thread")]
async fn blobs_in_a_folder() {
    let ground = Ground::new();
    let blobs = Blobs::open(&ground.blobs()).unwrap();
    blobs_keep_what_they_are_given(&blobs).await;
    let id = blobs.put(b"a graph".to_vec()).await.unwrap();
    let file = ground.path("blobs").join(&id.to_string()[..2]).join(id.to_string());
    std::fs::write(&file, b"a wraph").unwrap();
    let error = blobs.get(id).await.unwrap_err().to_string();
    assert!(error.contains(&id.to_string()) && error.contains("damaged"), "{error}");
    let error = Blobs::open("ftp://somewhere").unwrap_err().to_string();
    assert!(error.contains("--blobs ftp://somewhere: it is s3://"), "{error}");
}

#[tokio::test(flavor = "multi_thread")]
async fn blobs_in_an_object_store() {
    let ground = Ground::new();
    let s3 = S3::start(&ground);
    let relay = Relay::to(s3.address);
    let env = S3::env(relay.address);
    let options = env.iter().map(|(name, value)| (name.as_str(), value.as_str()));
    let blobs = Blobs::open_with(S3::BLOBS, options).unwrap();
    blobs_keep_what_they_are_given(&blobs).await;
    let id = blobs.put(b"a graph".to_vec()).await.unwrap();
    relay.refuse();
    let error = blobs.get(id).await.unwrap_err().to_string();
    assert!(error.starts_with(S3::BLOBS), "{error}");
    relay.mend();
    assert_eq!(blobs.get(id).await.unwrap().as_deref(), Some(&b"a graph"[..]));
}
