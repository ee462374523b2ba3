//! How a body uses pads, zip lines, teleporters and jetpacks.

use super::body::{Body, Ride, Support};
use super::profile::CharacterProfile;
use crate::map::features::ZIP_LIFT_M;
use crate::map::{CollisionMap, DeviceKind};
use crate::{Ability, AbilitySet, TICK_SECONDS, Vec3};

/// Share of the speed that a body keeps when it lets go of a zip line.
const ZIP_RELEASE_SHARE: f32 = 0.4;

impl Body {
    pub(super) fn enter_devices(&mut self, map: &CollisionMap, profile: &CharacterProfile, used: &mut AbilitySet) {
        let device = map.device_at(self.feet);
        self.teleport_locked &= device.is_some_and(|device| device.kind == DeviceKind::Teleporter);
        let Some(device) = device.filter(|device| profile.uses(device.kind)) else { return };
        match device.kind {
            DeviceKind::Pad if self.velocity.y <= 0.0 => {
                self.velocity.y = device.power;
                self.leave_ground();
                used.insert(Ability::PAD);
            }
            DeviceKind::ZipLine => {
                self.ride = Some(Ride { line_idx: device.idx, distance: 0.0 });
                self.leave_ground();
                self.jump_pending = false;
                used.insert(Ability::ZIP_LINE);
            }
            DeviceKind::Teleporter if !self.teleport_locked => {
                self.feet = device.exit() + Vec3::new(0.0, 0.1, 0.0);
                self.teleport_locked = true;
                used.insert(Ability::TELEPORTER);
            }
            DeviceKind::Jetpack => self.fuel = self.fuel.max(device.power),
            DeviceKind::Pad | DeviceKind::Teleporter => {}
        }
    }

    /// Rides a zip line for one tick. The cable determines the motion until its end, or until the body lets go by a
    /// jump.
    pub(super) fn ride_on(&mut self, map: &CollisionMap, profile: &CharacterProfile, ride: Ride) {
        let line = &map.placed().zip_lines[ride.line_idx as usize];
        let distance = ride.distance + profile.zip_line_speed * TICK_SECONDS;
        let (feet, direction) = line.at(distance.min(line.length()));
        self.feet = feet;
        self.velocity = direction * profile.zip_line_speed;
        self.support = Support::Air;
        let has_left_station = distance > 2.0 * ZIP_LIFT_M;
        let lets_go = self.jump_pending && has_left_station;
        if distance < line.length() && !lets_go {
            self.ride = Some(Ride { distance, ..ride });
            return;
        }
        self.ride = None;
        self.jump_pending = false;
        self.velocity *= ZIP_RELEASE_SHARE;
        self.air_jumps_left = profile.extra_jumps;
        (self.dash_ticks, self.has_dashed) = (0, false);
    }
}
