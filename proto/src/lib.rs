//! The gRPC contracts of Surefoot: generated code, file descriptors, and conversions of types that several services
//! use.
//!
//! The `.proto` files in this crate document shapes, units, ranges and errors. [`convert`] converts the types of the
//! world, [`plans`] those of planners, workers and clients, [`movement`] how NPCs move, [`zones`] zones and tags. The
//! file `wire.rs` of a service converts types that no other service uses. [`coordinates`] converts places of levels.
//! [`segments`] decodes a stream of segments for clients.
//! [`reason`] lists the machine-readable reasons of errors.

pub mod convert;
pub mod coordinates;
pub mod movement;
pub mod pieces;
pub mod plans;
pub mod reason;
pub mod segments;
pub mod zones;

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

/// Generated code of `surefoot.learn.v1`.
pub mod learn {
    #[expect(missing_docs, reason = "generated code")]
    pub mod v1 {
        tonic::include_proto!("surefoot.learn.v1");
    }
}

/// File descriptors of all packages, for gRPC reflection.
pub const FILE_DESCRIPTOR_SET: &[u8] = include_bytes!(concat!(env!("OUT_DIR"), "/descriptors.bin"));
