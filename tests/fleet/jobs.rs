//! Jobs and their answers as bytes.

use surefoot_fleet::work::job::{Job, JobKind, Refusal, open_answer, seal_answer};

#[test]
fn what_was_sealed_opens_and_nothing_else_does() {
    let job = Job::new(JobKind::Unit, 3, &(7u64, "text"));
    let opened = Job::open(&job.bytes).unwrap();
    assert_eq!((opened.id, opened.kind), (job.id, JobKind::Unit));
    assert_eq!(opened.body::<(u64, String)>(), Ok((7, "text".to_owned())));
    assert!(opened.body::<u8>().is_err(), "bytes too many");
    assert_ne!(Job::new(JobKind::Unit, 4, &(7u64, "text")).id, job.id);
    for cut in 0..job.bytes.len() {
        assert!(Job::open(&job.bytes[..cut]).is_err(), "cut at {cut}");
        let mut flipped = job.bytes.clone();
        flipped[cut] ^= 4;
        assert!(Job::open(&flipped).is_err(), "flipped at {cut}");
    }
}

#[test]
fn an_answer_belongs_to_one_job() {
    let [one, other] = [1, 2].map(|place| Job::new(JobKind::Map, place, &()).id);
    for answer in [Ok(vec![1, 2, 3]), Err(Refusal::impossible("no")), Err(Refusal::unable("not now"))] {
        let bytes = seal_answer(one, &answer);
        assert_eq!(open_answer(one, &bytes), Ok(answer));
        assert!(open_answer(other, &bytes).is_err());
        assert!(open_answer(one, &bytes[..bytes.len() - 1]).is_err());
    }
}
