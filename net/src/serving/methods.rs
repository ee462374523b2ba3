//! Properties of methods, from the contracts.

use crate::status;
use prost_reflect::{DescriptorPool, MethodDescriptor};
use std::collections::BTreeSet;
use std::sync::LazyLock;
use surefoot_proto::reason::Reason;
use tonic::Status;

/// Descriptors of all contracts.
pub(super) static POOL: LazyLock<DescriptorPool> = LazyLock::new(|| {
    DescriptorPool::decode(surefoot_proto::FILE_DESCRIPTOR_SET).expect("the contracts were compiled with this program")
});

/// Paths of the methods that take a stream of requests.
static CLIENT_STREAMS: LazyLock<BTreeSet<String>> = LazyLock::new(|| {
    let methods = POOL.services().flat_map(|service| service.methods().collect::<Vec<_>>());
    let streams = methods.filter(MethodDescriptor::is_client_streaming);
    streams.map(|method| format!("/{}/{}", method.parent_service().full_name(), method.name())).collect()
});

/// Whether the method at a path takes a stream of requests.
pub(super) fn takes_stream(path: &str) -> bool {
    CLIENT_STREAMS.contains(path)
}

/// Returns the method at a path such as `/surefoot.world.v1.WorldService/CreateWorld`.
pub(super) fn method_of(path: &str) -> Result<MethodDescriptor, Status> {
    let found = path.trim_start_matches('/').split_once('/').and_then(|(service, method)| {
        let service = POOL.get_service_by_name(service)?;
        service.methods().find(|found| found.name() == method)
    });
    found.ok_or_else(|| status::failure(Reason::UnknownMethod, format!("{path} is not a method of this service")))
}
