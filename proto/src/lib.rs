//! The gRPC contracts of Surefoot: generated code, file descriptors, and conversions of the types that several services share.
//!
//! Shapes, units, ranges and errors are documented in the `.proto` files beside this crate. [`convert`] turns wire types into the
//! world's own and back, [`plans`] those of planners, workers and clients; what only one service sends is converted by the file `wire.rs` of that service. [`reason`] lists
//! what errors carry for programs to act on.

pub mod convert;
pub mod plans;
pub mod reason;

/// Generated code of `surefoot.world.v1`.
pub mod world {
    #[expect(missing_docs, clippy::all, reason = "generated code")]
    pub mod v1 {
        tonic::include_proto!("surefoot.world.v1");
    }
}

/// Generated code of `surefoot.planner.v1`.
pub mod planner {
    #[expect(missing_docs, clippy::all, reason = "generated code")]
    pub mod v1 {
        tonic::include_proto!("surefoot.planner.v1");
    }
}

/// File descriptors of both packages, for gRPC reflection.
pub const FILE_DESCRIPTOR_SET: &[u8] = include_bytes!(concat!(env!("OUT_DIR"), "/descriptors.bin"));
