//! What a character has to be able to do to get somewhere.

use crate::character::TickEvents;
use serde::{Deserialize, Serialize};

/// The most demanding thing that a leg takes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default, Serialize, Deserialize)]
pub enum Ability {
    /// Walking, sliding, dropping.
    #[default]
    Walk,
    /// A jump from the ground.
    Jump,
    /// A second jump in the air.
    DoubleJump,
    /// A jump pad.
    Pad,
    /// A zip line.
    ZipLine,
    /// A teleporter.
    Teleporter,
    /// A jetpack's thrust.
    Jetpack,
}

impl Ability {
    /// All abilities, from the least demanding on.
    pub const ALL: [Ability; 7] = [
        Ability::Walk,
        Ability::Jump,
        Ability::DoubleJump,
        Ability::Pad,
        Ability::ZipLine,
        Ability::Teleporter,
        Ability::Jetpack,
    ];

    /// The ability behind what a body did.
    pub fn used(events: TickEvents) -> Self {
        if events.thrust {
            Ability::Jetpack
        } else if events.teleported {
            Ability::Teleporter
        } else if events.zipped {
            Ability::ZipLine
        } else if events.padded {
            Ability::Pad
        } else if events.double_jumped {
            Ability::DoubleJump
        } else if events.jumped {
            Ability::Jump
        } else {
            Ability::Walk
        }
    }

    /// Lower-case name.
    pub fn name(self) -> &'static str {
        match self {
            Ability::Walk => "walk",
            Ability::Jump => "jump",
            Ability::DoubleJump => "double_jump",
            Ability::Pad => "pad",
            Ability::ZipLine => "zip_line",
            Ability::Teleporter => "teleporter",
            Ability::Jetpack => "jetpack",
        }
    }
}
