//! Work that several processes share over NATS JetStream: probes of builds, units of evaluations, and maps to
//! generate.
//!
//! A [`job`] is sealed bytes that contain everything that its result depends on: its result is the same on every
//! prover. Results of one [`compute_class`] have the same bits. A [`dispatch`] sends jobs to the [`queue`], does some
//! of them in its own process, and takes the first result of each. Provers ([`prover`]) pull jobs and store results.
//! Kinds of jobs are [`probes`] and [`maps`] here, and evaluations in the command line. This module knows nothing of
//! graphs.
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
