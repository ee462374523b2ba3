//! What a node of a level stands for.

use crate::pairs::End;
use crate::report::Role;
use surefoot_world::map::{DeviceKind, Liquid, MoverKind};

/// What a node stands for.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Kind {
    Pool(Liquid),
    /// A device, with the end and the name of the pair for one end of a transport whose node says which end it is.
    Device(DeviceKind, Option<(End, String)>),
    /// A spot with its tag, and the end and the name of its pair if it is one end of a way.
    Spot(String, Option<(End, String)>),
    /// A door, lift, platform, floor or conveyor.
    Mover(MoverKind),
    /// A ladder: its box can be climbed.
    Ladder,
    /// A wall or a net: its shape can be climbed.
    Climb,
    /// A place on the path of a mover.
    Path,
    /// Something for a tool or an engine.
    Helper,
    /// No part of the level.
    LeftOut,
}

impl Kind {
    /// The role in reports.
    pub(super) fn role(&self) -> Role {
        match self {
            Self::Pool(Liquid::Water) => Role::Water,
            Self::Pool(Liquid::Lava) => Role::Lava,
            Self::Device(DeviceKind::Pad, _) => Role::Pad,
            Self::Device(DeviceKind::ZipLine, _) => Role::ZipLine,
            Self::Device(DeviceKind::Teleporter, _) => Role::Teleporter,
            Self::Device(DeviceKind::Jetpack, _) => Role::Jetpack,
            Self::Spot(..) => Role::Spot,
            Self::Mover(MoverKind::Door) => Role::Door,
            Self::Mover(MoverKind::Lift) => Role::Lift,
            Self::Mover(MoverKind::Platform) => Role::Platform,
            Self::Mover(MoverKind::Floor) => Role::Floor,
            Self::Mover(MoverKind::Conveyor) => Role::Conveyor,
            Self::Mover(MoverKind::Crate) => Role::Crate,
            Self::Ladder => Role::Ladder,
            Self::Climb => Role::Climb,
            Self::Path => Role::Path,
            Self::Helper => Role::Helper,
            Self::LeftOut => Role::LeftOut,
        }
    }

    /// Whether the name lacks the end that its feature needs.
    pub(super) fn lacks_end(&self) -> bool {
        matches!(self, Self::Device(kind, None) if kind.is_transport())
    }

    pub(super) fn has_end(&self) -> bool {
        matches!(self, Self::Device(_, Some(_)) | Self::Spot(_, Some(_)))
    }
}

/// What a node stands for, and why.
#[derive(Debug, Clone, Default)]
pub(super) struct Meaning {
    /// `None`: the node is solid, unless it belongs to another that is not.
    pub(super) kind: Option<Kind>,
    /// As in a report.
    pub(super) reason: String,
    /// Whether the sidecar, a property or the file says so, and no name.
    pub(super) is_declared: bool,
    /// Whether a designer declared it solid.
    pub(super) is_declared_solid: bool,
}

impl Meaning {
    /// A node that is not solid.
    pub(super) fn new(kind: Kind, reason: impl Into<String>) -> Self {
        Self { kind: Some(kind), reason: reason.into(), ..Self::default() }
    }

    /// A node that is no part of the level.
    pub(super) fn left_out(reason: impl Into<String>) -> Self {
        Self::new(Kind::LeftOut, reason)
    }

    /// A node that a designer declared solid.
    pub(super) fn solid(reason: &str) -> Self {
        Self { reason: reason.to_owned(), is_declared_solid: true, ..Self::default() }
    }
}
