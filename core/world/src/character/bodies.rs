//! Named bodies: Surefoot's own, those of common engines, and a few unusual ones.

use super::own::{OwnMotion, OwnMove};
use super::profile::{CharacterProfile, RawCharacterProfile};
use crate::map::spot::ANCHOR;

/// A body with a name.
#[derive(Debug, Clone, Copy)]
pub struct NamedBody {
    /// Lower-case name, as in commands.
    pub name: &'static str,
    /// Description and source of the figures.
    pub about: &'static str,
    change: fn(&mut RawCharacterProfile),
}

/// All named bodies.
pub const BODIES: [NamedBody; 11] = [
    NamedBody {
        name: "surefoot",
        about: "the default: the paper's body, with steps as high as stairs have",
        change: |_| {},
    },
    NamedBody {
        name: "paper",
        about: "the body of the environment that the paper's authors released, with steps of 0.1 m",
        change: |it| *it = RawCharacterProfile::of_paper(),
    },
    NamedBody {
        name: "unreal",
        about: "Unreal Engine's Character and CharacterMovementComponent with their default values",
        change: |it| {
            (it.height, it.radius) = (1.76, 0.34);
            (it.forward_speed, it.side_speed_share, it.turn_speed) = (6.0, 1.0, 360.0f32.to_radians());
            (it.jump_speed, it.gravity, it.extra_jumps) = (4.2, 9.8, 0);
            (it.max_slope, it.step_height) = (44.765f32.to_radians(), 0.339);
            (it.ground_acceleration, it.air_acceleration) = (20.48, 1.0);
            (it.uses_zip_lines, it.uses_jetpacks) = (false, false);
        },
    },
    NamedBody {
        name: "godot",
        about: "Godot's CharacterBody3D script template: SPEED 5, JUMP_VELOCITY 4.5, gravity 9.8, \
                floor_max_angle 45 degrees",
        change: |it| {
            (it.height, it.radius) = (2.0, 0.5);
            (it.forward_speed, it.side_speed_share, it.turn_speed) = (5.0, 1.0, 360.0f32.to_radians());
            (it.jump_speed, it.gravity, it.extra_jumps) = (4.5, 9.8, 0);
            (it.max_slope, it.step_height) = (45.0f32.to_radians(), 0.0);
            // The template sets the velocity at once, on the ground and in the air.
            (it.ground_acceleration, it.air_acceleration) = (300.0, 300.0);
            (it.uses_zip_lines, it.uses_jetpacks) = (false, false);
        },
    },
    NamedBody {
        name: "unity",
        about: "Unity's Starter Assets third-person controller: sprint 5.335 m/s, jump height 1.2 m, gravity -15, \
                step offset 0.25 m",
        change: |it| {
            (it.height, it.radius) = (1.8, 0.28);
            (it.forward_speed, it.side_speed_share, it.turn_speed) = (5.335, 1.0, 360.0f32.to_radians());
            (it.jump_speed, it.gravity, it.extra_jumps) = (6.0, 15.0, 0);
            (it.max_slope, it.step_height) = (45.0f32.to_radians(), 0.25);
            (it.ground_acceleration, it.air_acceleration) = (53.0, 50.0);
            (it.uses_zip_lines, it.uses_jetpacks) = (false, false);
        },
    },
    NamedBody {
        name: "heavy",
        about: "large, slow and bound to the ground",
        change: |it| {
            (it.height, it.radius) = (2.8, 0.7);
            (it.forward_speed, it.turn_speed) = (5.0, 2.0);
            (it.jump_speed, it.gravity, it.extra_jumps) = (5.5, 25.0, 0);
            it.step_height = 0.4;
            (it.ground_acceleration, it.air_acceleration) = (20.0, 4.0);
        },
    },
    NamedBody {
        name: "small",
        about: "the size of a cat, with a good jump",
        change: |it| {
            (it.height, it.radius) = (0.6, 0.2);
            (it.forward_speed, it.turn_speed) = (6.0, 6.0);
            (it.jump_speed, it.gravity, it.extra_jumps) = (7.0, 15.0, 0);
            it.step_height = 0.15;
        },
    },
    NamedBody {
        name: "climber",
        about: "the paper's body, with three jumps in a row",
        change: |it| {
            *it = RawCharacterProfile::of_paper();
            (it.forward_speed, it.extra_jumps) = (8.0, 2);
            it.max_slope = 45.0f32.to_radians();
        },
    },
    NamedBody {
        name: "agile",
        about: "climbs ladders, pulls itself up to ledges of 1.9 m, swims, and crouches to 0.9 m",
        change: |it| {
            (it.height, it.radius) = (1.8, 0.3);
            (it.forward_speed, it.turn_speed) = (6.5, 360.0f32.to_radians());
            (it.jump_speed, it.gravity, it.extra_jumps) = (6.0, 15.0, 0);
            it.max_slope = 45.0f32.to_radians();
            (it.climb_speed, it.mantle_height, it.swim_speed, it.crouch_height) = (2.0, 1.9, 2.5, 0.9);
        },
    },
    NamedBody {
        name: "dasher",
        about: "like `agile`, with a dash in the air at 16 m/s",
        change: |it| {
            let agile = NamedBody::find("agile").expect("a named body").profile();
            *it = RawCharacterProfile { dash_speed: 16.0, ..(*agile).clone() };
        },
    },
    NamedBody {
        name: "acrobat",
        about: "like `agile`; also runs along walls, slides, dives, and pulls itself to anchors (`grapple`)",
        change: |it| {
            let agile = NamedBody::find("agile").expect("a named body").profile();
            *it = (*agile).clone();
            (it.wall_run_seconds, it.slide_seconds, it.dive_seconds) = (1.5, 1.0, 15.0);
            let grapple = OwnMove::new("grapple", OwnMotion::Tether);
            it.moves = [OwnMove { spot: ANCHOR.to_owned(), speed: 16.0, ..grapple }].into();
        },
    },
];

impl NamedBody {
    /// The body with this name.
    pub fn find(name: &str) -> Option<Self> {
        BODIES.into_iter().find(|body| body.name == name)
    }

    /// The profile of the body.
    pub fn profile(&self) -> CharacterProfile {
        CharacterProfile::default().with(self.change).expect("named bodies are in range")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_named_body_is_in_range_and_unlike_the_others() {
        for (idx, body) in BODIES.iter().enumerate() {
            let profile = body.profile();
            assert!(BODIES[..idx].iter().all(|other| other.profile() != profile), "{}", body.name);
            assert_eq!(NamedBody::find(body.name).unwrap().profile(), profile);
        }
    }
}
