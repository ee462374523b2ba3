//! Shares of workers, quotas of clients, and times of ticks.

use std::time::Duration;
use surefoot_server::ids::WorkerId;
use surefoot_server::messages::Hello;
use surefoot_server::quota::{Quota, Ticket};
use surefoot_server::registry::Registry;
use surefoot_server::times::TickTimes;
use tokio::sync::mpsc::channel;

fn npc_counts(registry: &Registry) -> Vec<u32> {
    registry.load().iter().map(|worker| worker.npc_count).collect()
}

#[test]
fn a_worker_that_joins_takes_its_share_and_no_more() {
    let registry = Registry::default();
    let join = |capacity| registry.join(Hello::new("", "", capacity), channel(1).0).id;
    let first = join(100);
    let mut holders: Vec<WorkerId> = (0..90).map(|_| registry.assign().unwrap()).collect();
    assert_eq!(npc_counts(&registry), [90]);
    join(50);
    let moved = holders
        .iter_mut()
        .filter_map(|holder| registry.move_to_less_loaded(*holder).map(|next| *holder = next))
        .count();
    assert_eq!(moved, 30, "a third of the capacity is new");
    assert_eq!(npc_counts(&registry), [60, 30]);
    assert!(holders.iter().all(|&holder| registry.move_to_less_loaded(holder).is_none()), "an even load stays");
    registry.leave(first);
    assert_eq!(npc_counts(&registry), [30]);
    assert_eq!((0..40).filter(|_| registry.assign().is_some()).count(), 20, "a full worker gets no more");
}

#[test]
fn parallel_calls_of_one_client_do_not_exceed_its_quota() {
    let quota = Quota::new(1000, "things");
    let acquire = |_| {
        std::thread::spawn({
            let quota = quota.clone();
            move || (0..500).filter_map(|_| quota.acquire("client").ok()).collect::<Vec<_>>()
        })
    };
    let threads: Vec<_> = (0..8).map(acquire).collect();
    let held: Vec<Vec<Ticket>> = threads.into_iter().map(|thread| thread.join().unwrap()).collect();
    assert_eq!(held.iter().map(Vec::len).sum::<usize>(), 1000);
    drop(held);
    assert!(quota.acquire("client").is_ok());
}

#[test]
fn every_duration_lies_below_the_bound_of_its_bucket_and_not_below_the_one_before() {
    for us in [0.0, 9.9, 10.1, 11.9, 12.0, 999.0, 16_667.0, 40_000.0, 600_000.0] {
        let took = Duration::from_secs_f64(us * 1.0e-6);
        let mut times = TickTimes::default();
        times.note(took);
        let idx = times.counts().iter().position(|count| *count == 1).unwrap();
        assert!(took < TickTimes::bound(idx), "{us} us in bucket {idx}");
        assert!(idx == 0 || took >= TickTimes::bound(idx - 1), "{us} us in bucket {idx}");
    }
}

#[test]
fn quantiles_are_at_most_a_bucket_too_high() {
    let mut times = TickTimes::default();
    (1..=1000).for_each(|us| times.note(Duration::from_micros(us * 10)));
    for (share, exact) in [(0.5, 5000.0), (0.99, 9900.0)] {
        let found = times.quantile_us(share);
        assert!((exact..exact * 1.2).contains(&found), "{share}: {found}");
    }
    assert_eq!(times.count(), 1000);
    assert_eq!(TickTimes::default().quantile_us(0.99), 0.0);
}
