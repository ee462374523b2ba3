//! Work that several processes share over NATS JetStream: probes of builds, units of evaluations, maps to generate.
//!
//! A [`job`] is sealed bytes that say everything that its result depends on, so that its result is the same whoever does it, however
//! often. Jobs of one [`lane`] have results with the same bits. A [`dispatch`] sends jobs to the [`queue`], does some of them in its own
//! process, and takes the first result of each; provers ([`prover`]) pull jobs and store results. What kinds of jobs there are:
//! [`probes`] and [`maps`] here, evaluations in the command line. This module does not know what a graph is.
//!
//! Start reading at [`dispatch`].

mod board;
pub mod compute_class;
pub mod dispatch;
mod feed;
pub mod job;
pub mod map_cache;
pub mod maps;
pub mod probes;
pub mod prover;
pub mod queue;
