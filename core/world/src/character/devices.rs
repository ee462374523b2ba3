//! How a body uses pads, zip lines, teleporters and jetpacks.

use super::body::{Body, Ride, Support};
use super::profile::CharacterProfile;
use crate::map::features::ZIP_LIFT_M;
use crate::map::{CollisionMap, Zone};
use crate::{Ability, AbilitySet, TICK_SECONDS, Vec3};

/// Share of the speed that a body keeps when it lets go of a zip line.
const ZIP_RELEASE_SHARE: f32 = 0.4;

impl Body {
    pub(super) fn enter_devices(&mut self, map: &CollisionMap, profile: &CharacterProfile, used: &mut AbilitySet) {
        let device = map.device_at(self.feet);
        if !matches!(device, Some(Zone::Teleporter(_) | Zone::TeleporterBack(_))) {
            self.teleport_locked = false;
        }
        match device {
            Some(Zone::Pad(idx)) if self.velocity.y <= 0.0 => {
                self.velocity.y = map.placed().pads[idx as usize].speed;
                self.leave_ground();
                used.insert(Ability::Pad);
            }
            Some(Zone::ZipLine(line_idx)) if profile.uses_zip_lines => {
                self.ride = Some(Ride { line_idx, distance: 0.0 });
                self.leave_ground();
                self.jump_pending = false;
                used.insert(Ability::ZipLine);
            }
            Some(Zone::Teleporter(idx)) if !self.teleport_locked => {
                self.teleport_to(map.placed().teleporters[idx as usize].to, used);
            }
            Some(Zone::TeleporterBack(idx)) if !self.teleport_locked => {
                self.teleport_to(map.placed().teleporters[idx as usize].from, used);
            }
            Some(Zone::Jetpack(idx)) if profile.uses_jetpacks => {
                self.fuel = self.fuel.max(map.placed().jetpacks[idx as usize].fuel);
            }
            _ => {}
        }
    }

    fn teleport_to(&mut self, place: Vec3, used: &mut AbilitySet) {
        self.feet = place + Vec3::new(0.0, 0.1, 0.0);
        self.teleport_locked = true;
        used.insert(Ability::Teleporter);
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
    }
}
