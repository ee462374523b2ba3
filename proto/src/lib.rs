//! The gRPC contracts of Surefoot: generated code, file descriptors and conversions to checked types.
//!
//! Shapes, units, ranges and errors are documented in the `.proto` files beside this crate. [`convert`] is the
//! only place where wire types become the world's own; [`serving`] is what every endpoint has in common, [`client`] the
//! other end of its connections.

pub mod client;
pub mod convert;
pub mod maps;
pub mod secret;
pub mod serving;
pub mod status;

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
