//! Abilities: what a character must be able to do to traverse a leg.

use crate::character::TickEvents;
use serde::{Deserialize, Serialize};

/// The most demanding ability that a leg needs, ordered from the least demanding.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default, Serialize, Deserialize)]
pub enum Ability {
    /// Walking, sliding or dropping.
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
    /// All abilities, the least demanding first.
    pub const ALL: [Ability; 7] = [
        Ability::Walk,
        Ability::Jump,
        Ability::DoubleJump,
        Ability::Pad,
        Ability::ZipLine,
        Ability::Teleporter,
        Ability::Jetpack,
    ];

    /// The most demanding ability among `events`; [`Ability::Walk`] if there were none.
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

    /// Name in snake case, as used in reports and exports.
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
