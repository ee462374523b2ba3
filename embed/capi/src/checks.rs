//! Checks arguments: numbers become values of the simulation, or errors that name them.

use crate::abi::{Action, Body, Frame, Place, Vec3};
use crate::error::Fault;
use surefoot_world as world;
use surefoot_world::Ability;
use surefoot_world::map::{LevelFrame, UpAxis};
use surefoot_world::mesh::Surface;

/// Largest coordinate, m, or speed, m/s.
const MOST: f32 = 1.0e6;

impl Vec3 {
    /// The vector, if all values are finite and at most a million; `name` names it in errors.
    pub fn checked(self, name: impl std::fmt::Display) -> Result<world::Vec3, Fault> {
        let Self { x, y, z } = self;
        if [x, y, z].iter().all(|value| value.abs() <= MOST) {
            return Ok(world::Vec3::new(x, y, z));
        }
        Err(Fault::argument(format!("{name} is ({x}, {y}, {z}): all three must be finite, and at most a million")))
    }

    /// The place on the map, m, checked. With a `frame`, this place is in the coordinates of a level, else of the map.
    pub fn on_map(self, frame: Option<&LevelFrame>, name: impl std::fmt::Display) -> Result<world::Vec3, Fault> {
        let Some(frame) = frame else { return self.checked(name) };
        let Self { x, y, z } = self;
        Self::from(frame.to_map(world::Vec3::new(x, y, z).as_dvec3())).checked(name)
    }

    /// A place of the map, m, in these coordinates.
    pub fn of_map(place: world::Vec3, frame: Option<&LevelFrame>) -> Self {
        frame.map_or(place, |frame| frame.to_level(place).as_vec3()).into()
    }
}

impl Place {
    /// The place, if all values are finite; `name` names it in errors.
    pub fn checked(self, name: impl std::fmt::Display) -> Result<world::DVec3, Fault> {
        let Self { x, y, z } = self;
        let place = world::DVec3::new(x, y, z);
        let message = || format!("{name} is ({x}, {y}, {z}): all three must be finite");
        if place.is_finite() { Ok(place) } else { Err(Fault::argument(message())) }
    }
}

impl Frame {
    /// The frame, if all values are in range.
    pub fn checked(self) -> Result<LevelFrame, Fault> {
        let Self { origin, scale, z_up } = self;
        if !(scale > 0.0 && scale.is_finite()) {
            return Err(Fault::argument(format!("frame.scale is {scale}, but must be above 0")));
        }
        let up = if z_up == 0 { UpAxis::Y } else { UpAxis::Z };
        Ok(LevelFrame { origin: origin.checked("frame.origin")?, scale, up })
    }
}

impl TryFrom<Action> for world::Action {
    type Error = Fault;

    fn try_from(Action { forward, strafe, turn, jump }: Action) -> Result<Self, Fault> {
        Self::from_array([forward, strafe, turn, jump]).map_err(|error| Fault::argument(error.to_string()))
    }
}

/// The surface with this number; `None` for 0.
pub fn surface(number: i32) -> Result<Option<Surface>, Fault> {
    if number == 0 {
        return Ok(None);
    }
    let surface = usize::try_from(number.wrapping_sub(1)).ok().and_then(|idx| Surface::ALL.get(idx));
    let unknown = || Fault::argument(format!("surface is {number}: it must be one of sf_surface, 0 to 8"));
    surface.copied().map(Some).ok_or_else(unknown)
}

/// The ability with this number.
pub fn ability(number: i32) -> Result<Ability, Fault> {
    let found = usize::try_from(number).ok().and_then(Ability::at);
    found.ok_or_else(|| Fault::argument(format!("ability is {number}: it must be one of sf_ability, or an own move")))
}

impl Body {
    /// The profile, if all values are in range.
    pub fn profile(&self) -> Result<world::CharacterProfile, Fault> {
        let count = |name: &str, value: u32, most: u8| {
            u8::try_from(value)
                .ok()
                .filter(|value| *value <= most)
                .ok_or_else(|| Fault::argument(format!("body.{name} is {value}, but must be 0 to {most}")))
        };
        let raw = world::RawCharacterProfile {
            height: self.height,
            radius: self.radius,
            forward_speed: self.forward_speed,
            side_speed_share: self.side_speed_share,
            turn_speed: self.turn_speed,
            jump_speed: self.jump_speed,
            gravity: self.gravity,
            extra_jumps: count("extra_jumps", self.extra_jumps, u8::MAX)?,
            max_slope: self.max_slope,
            step_height: self.step_height,
            ground_acceleration: self.ground_acceleration,
            air_acceleration: self.air_acceleration,
            climb_speed: self.climb_speed,
            mantle_height: self.mantle_height,
            swim_speed: self.swim_speed,
            crouch_height: self.crouch_height,
            dash_speed: self.dash_speed,
            wall_run_seconds: self.wall_run_seconds,
            slide_seconds: self.slide_seconds,
            dive_seconds: self.dive_seconds,
            moves: Default::default(),
            coyote_ticks: count("coyote_ticks", self.coyote_ticks, u8::MAX - 1)?,
            uses_zip_lines: self.uses_zip_lines != 0,
            zip_line_speed: self.zip_line_speed,
            uses_jetpacks: self.uses_jetpacks != 0,
            jetpack_acceleration: self.jetpack_acceleration,
            jetpack_climb_speed: self.jetpack_climb_speed,
        };
        raw.try_into().map_err(|error: world::ProfileError| Fault::argument(error.to_string()))
    }
}
