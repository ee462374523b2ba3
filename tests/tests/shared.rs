//! What endpoints share: the memory budget, uploads, pages, reasons and repeatable calls.

use std::sync::Arc;
use surefoot_net::idempotency::{AnswerCache, Repeatable};
use surefoot_net::levels::uploads::{UploadError, Uploads};
use surefoot_net::memory::MemoryBudget;
use surefoot_net::paging::{PageSize, page, page_by_id};
use surefoot_net::status::{self, with_reason};
use surefoot_proto::reason::Reason;
use tonic::{Code, Status};

/// Most bytes of answers that are kept for a client.
const MAX_CLIENT_BYTES: u64 = 8 << 20;
const REQUEST: &str = "the request";

fn call<'a>(client: &'a Arc<str>, request_id: &'a str) -> Repeatable<'a> {
    Repeatable { client, request_id, answer_bytes: 0 }
}

#[test]
fn a_refusal_names_the_holders_and_what_is_dropped_makes_room() {
    let budget = MemoryBudget::new(1_000_000_000);
    let held = budget.reserve("studio", 700_000_000).unwrap();
    let mut small = budget.reserve("game", 100_000_000).unwrap();
    let refused = budget.reserve("game", 300_000_000).unwrap_err().to_string();
    assert!(
        refused.contains("about 300 MB, but 800 of 1000 MB are in use (studio: 700 MB, game: 100 MB)"),
        "{refused}"
    );
    assert!(small.resize(400_000_000).is_err());
    assert_eq!(budget.used_bytes(), 800_000_000, "a refusal changes nothing");
    drop(held);
    small.resize(400_000_000).unwrap();
    assert_eq!(budget.used_bytes(), 400_000_000);
    drop(small);
    assert_eq!(budget.used_bytes(), 0);
}

#[test]
fn parts_make_a_file_repeats_are_harmless_and_gaps_are_refused() {
    let budget = MemoryBudget::new(1000);
    let uploads = Uploads::new(budget.clone());
    let (ann, bob): (Arc<str>, Arc<str>) = ("ann".into(), "bob".into());
    assert_eq!(uploads.append(&ann, "a", 0, b"0123"), Ok(4));
    assert_eq!(uploads.append(&ann, "a", 0, b"0123"), Ok(4), "sent again");
    assert_eq!(uploads.append(&ann, "a", 2, b"2345"), Ok(6), "overlapping");
    assert_eq!(uploads.append(&ann, "a", 9, b"9"), Err(UploadError::Offset { offset: 9, received: 6 }));
    let whole = |len: usize| len as u64;
    let unknown = uploads.take(&bob, "a", whole).unwrap_err();
    assert_eq!(unknown, UploadError::Unknown("a".to_owned()), "the upload of another client");
    assert!(matches!(uploads.append(&bob, "b", 0, &[0; 2000]), Err(UploadError::Memory(_))));
    let refused = uploads.take(&ann, "a", |len| len as u64 * 1000).unwrap_err();
    assert!(matches!(refused, UploadError::Memory(_)));
    let taken = uploads.take(&ann, "a", |len| len as u64 * 100).expect("a refusal leaves the upload");
    assert_eq!((&taken.bytes[..], budget.used_bytes()), (&b"012345"[..], 600));
    drop(taken);
    assert_eq!(budget.used_bytes(), 0);
    assert!(uploads.take(&ann, "a", whole).is_err());
    (0..4).for_each(|id| _ = uploads.append(&ann, &format!("many {id}"), 0, b"x").unwrap());
    assert_eq!(uploads.append(&ann, "one more", 0, b"x"), Err(UploadError::TooMany));
}

#[test]
fn pages_follow_one_another_without_gaps_or_repeats() {
    let size = PageSize { default: 3, max: 5 };
    let mut token = String::new();
    let mut seen = Vec::new();
    let mut pages = 0;
    loop {
        let page = page_by_id(1..=7u64, |id| *id, size, 0, &token).unwrap();
        seen.extend(page.items);
        pages += 1;
        token = page.next_token;
        if token.is_empty() {
            break;
        }
    }
    assert_eq!((seen, pages), ((1..=7).collect::<Vec<u64>>(), 3));
    assert_eq!(page_by_id(1..=5u64, |id| *id, size, 5, "").unwrap().next_token, "", "a full last page is the last");
    // The item of the token may be gone: ids only grow.
    assert_eq!(page_by_id([1u64, 4, 5], |id| *id, size, 0, "3").unwrap().items, [4, 5]);
    let names = ["c", "a", "b"].map(str::to_owned);
    assert_eq!(page(names.clone(), String::clone, size, 1, "a").unwrap().items, ["b"]);
    assert_eq!(Reason::of(&page(names, String::clone, size, 1, "z").unwrap_err()), Some(Reason::InvalidPageToken));
    assert_eq!(Reason::of(&page_by_id([1u64], |id| *id, size, 6, "").unwrap_err()), Some(Reason::TooLarge));
    assert!(page_by_id([1u64], |id| *id, size, 0, "x").is_err());
}

#[test]
fn a_call_that_was_given_up_and_one_that_took_too_long_differ() {
    for (code, message, reason) in [
        (Code::Cancelled, "the stream was reset", Reason::Cancelled),
        (Code::Cancelled, "Timeout expired", Reason::DeadlineExceeded),
        (Code::DeadlineExceeded, "", Reason::DeadlineExceeded),
    ] {
        let status = with_reason(Status::new(code, message));
        assert_eq!((status.code(), Reason::of(&status)), (reason.code(), Some(reason)));
    }
}

#[tokio::test]
async fn a_flood_makes_a_client_forget_its_own_oldest_answers_only_and_its_bytes_are_bounded() {
    let budget = MemoryBudget::new(1 << 30);
    let answers = AnswerCache::<u32>::new(budget.clone());
    let (alice, bob): (Arc<str>, Arc<str>) = ("alice".into(), "bob".into());
    let request = REQUEST.to_owned();
    fn large<'a>(client: &'a Arc<str>, request_id: &'a str) -> Repeatable<'a> {
        Repeatable { client, request_id, answer_bytes: 100_000 }
    }
    answers.once(call(&bob, "first"), &request, async { Ok(7) }).await.unwrap();
    for number in 0..1000 {
        answers.once(large(&alice, &number.to_string()), &request, async move { Ok(number) }).await.unwrap();
        assert!(budget.used_bytes() <= MAX_CLIENT_BYTES + 1000);
    }
    assert!(budget.used_bytes() > MAX_CLIENT_BYTES - 200_000);
    let again = answers.once(call(&bob, "first"), &request, async { Ok(8) }).await.unwrap();
    assert_eq!(again, 7, "the answer of another client is kept");
    assert_eq!(answers.once(large(&alice, "999"), &request, async { Ok(8) }).await.unwrap(), 999);
    assert_eq!(answers.once(large(&alice, "0"), &request, async { Ok(8) }).await.unwrap(), 8, "it is forgotten");
}

#[tokio::test]
async fn without_memory_a_call_is_refused_before_it_runs_and_running_calls_are_not_forgotten() {
    let budget = MemoryBudget::new(1 << 30);
    let answers = AnswerCache::<u32>::new(budget.clone());
    let (alice, bob): (Arc<str>, Arc<str>) = ("alice".into(), "bob".into());
    let (go, gate) = tokio::sync::oneshot::channel::<()>();
    let slow = async move {
        gate.await.unwrap();
        Ok(1)
    };
    let whole = |request_id| Repeatable { client: &alice, request_id, answer_bytes: MAX_CLIENT_BYTES as usize };
    let request = REQUEST.to_owned();
    let mut running = Box::pin(answers.once(whole("slow"), &request, slow));
    assert!(std::future::poll_fn(|context| std::task::Poll::Ready(running.as_mut().poll(context).is_pending())).await);
    let forbidden = || async { Err(status::failure(Reason::Internal, "it must not run")) };
    let refused = answers.once(call(&alice, "next"), &request, forbidden()).await.unwrap_err();
    assert_eq!(Reason::of(&refused), Some(Reason::OutOfMemory));
    go.send(()).unwrap();
    assert_eq!(running.await.unwrap(), 1);
    answers.once(call(&alice, "next"), &request, async { Ok(2) }).await.unwrap();
    let _all = budget.reserve("worlds", (1 << 30) - budget.used_bytes()).unwrap();
    let refused = answers.once(call(&bob, "a"), &request, forbidden()).await.unwrap_err();
    assert_eq!(Reason::of(&refused), Some(Reason::OutOfMemory));
    let again = answers.once(call(&alice, "next"), &request, async { Ok(3) }).await.unwrap();
    assert_eq!(again, 2, "a kept answer needs no memory");
}
