//! [`Device`]: a pad, zip line, teleporter or jetpack pick-up, for code that treats them alike.
//!
//! [`Placed`] has a list for each kind, because maps are hashed and saved like that. [`Placed::devices`] joins the
//! lists, and [`Placed::add`] extends the right one. A new kind needs a list, a [`Surface`], a [`DeviceKind`], and an
//! arm in each match that the compiler then refuses.

use super::features::{CATCH_HEIGHT_M, DISC_RADIUS_M, Jetpack, Pad, Placed, Teleporter, ZIP_LIFT_M, ZipLine};
use crate::Vec3;
use crate::mesh::Surface;
use strum::VariantArray;

/// Range within which an NPC senses devices, m.
pub const DEVICE_RANGE_M: f32 = 50.0;

/// Kind of a device, with the number of the surface of its discs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, VariantArray)]
#[repr(u8)]
pub enum DeviceKind {
    /// Throws bodies upwards.
    Pad = Surface::Pad as u8,
    /// Takes bodies along a cable.
    ZipLine = Surface::ZipLine as u8,
    /// Moves bodies to another place at once.
    Teleporter = Surface::Teleporter as u8,
    /// Gives bodies a jetpack.
    Jetpack = Surface::Jetpack as u8,
}

impl DeviceKind {
    /// All kinds.
    pub const ALL: &[DeviceKind] = Self::VARIANTS;

    /// The kind with such discs; `None` for ground and liquids.
    pub fn of(surface: Surface) -> Option<Self> {
        Self::ALL.iter().copied().find(|kind| kind.surface() == surface)
    }

    /// Surface of its discs.
    pub fn surface(self) -> Surface {
        Surface::ALL[self as usize]
    }

    /// Name in snake case, with which the names of nodes in levels begin.
    pub fn name(self) -> &'static str {
        self.surface().name()
    }

    /// Name of a list of them in snake case.
    pub fn plural(self) -> String {
        format!("{}s", self.name())
    }

    /// Whether such devices lead to another place.
    pub fn is_transport(self) -> bool {
        matches!(self, DeviceKind::ZipLine | DeviceKind::Teleporter)
    }
}

/// A device of any kind.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Device {
    /// Kind of the device.
    pub kind: DeviceKind,
    /// Index in the list of its kind; [`Placed::add`] ignores it.
    pub idx: u32,
    /// Centre of the disc that bodies enter, on the ground, m.
    pub from: Vec3,
    /// Place that a zip line or teleporter leads to, on the ground, m; `None` for others.
    pub to: Option<Vec3>,
    /// Whether `to` is an entrance too.
    pub two_way: bool,
    /// Speed that a pad gives, m/s, or thrust that a jetpack gives, s; 0 for others.
    pub power: f32,
}

impl Device {
    /// A device that leads nowhere and has no power.
    pub fn new(kind: DeviceKind, from: Vec3) -> Self {
        Self { kind, idx: 0, from, to: None, two_way: false, power: 0.0 }
    }

    /// The device, and once more with its ends exchanged if bodies enter it at both.
    pub fn entrances(self) -> impl Iterator<Item = Device> {
        let back = self.to.filter(|_| self.two_way).map(|to| Device { from: to, to: Some(self.from), ..self });
        std::iter::once(self).chain(back)
    }

    /// Its places on the ground, m: one or two.
    pub fn ends(self) -> impl Iterator<Item = Vec3> {
        std::iter::once(self.from).chain(self.to)
    }

    /// Place where bodies leave it, m: the end of a zip line's cable, which is in the air, or the place it leads to.
    pub fn exit(self) -> Vec3 {
        let end = self.to.unwrap_or(self.from);
        if self.kind == DeviceKind::ZipLine { end + Vec3::new(0.0, ZIP_LIFT_M, 0.0) } else { end }
    }

    /// All of its numbers.
    pub fn numbers(self) -> impl Iterator<Item = f32> {
        self.ends().flat_map(|end| end.to_array()).chain([self.power])
    }

    /// Whether it catches a character with its feet at `feet`.
    pub(super) fn catches(&self, feet: Vec3) -> bool {
        let offset = feet - self.from;
        offset.y.abs() < CATCH_HEIGHT_M && offset.x * offset.x + offset.z * offset.z < DISC_RADIUS_M * DISC_RADIUS_M
    }
}

impl Placed {
    /// All devices, kind by kind.
    pub fn devices(&self) -> impl Iterator<Item = Device> {
        DeviceKind::ALL.iter().flat_map(move |kind| self.devices_of(*kind))
    }

    /// The devices of a kind.
    pub fn devices_of(&self, kind: DeviceKind) -> impl Iterator<Item = Device> {
        (0..).map_while(move |idx| self.device(kind, idx))
    }

    fn device(&self, kind: DeviceKind, idx: u32) -> Option<Device> {
        let at = idx as usize;
        let (from, to, two_way, power) = match kind {
            DeviceKind::Pad => self.pads.get(at).map(|it| (it.centre, None, false, it.speed)),
            DeviceKind::ZipLine => self.zip_lines.get(at).map(|it| (it.from, Some(it.to), false, 0.0)),
            DeviceKind::Teleporter => self.teleporters.get(at).map(|it| (it.from, Some(it.to), it.two_way, 0.0)),
            DeviceKind::Jetpack => self.jetpacks.get(at).map(|it| (it.centre, None, false, it.fuel)),
        }?;
        Some(Device { kind, idx, from, to, two_way, power })
    }

    /// Adds a device to the list of its kind.
    pub fn add(&mut self, Device { kind, from, to, two_way, power, .. }: Device) {
        let to = to.unwrap_or(from);
        match kind {
            DeviceKind::Pad => self.pads.push(Pad { centre: from, speed: power }),
            DeviceKind::ZipLine => self.zip_lines.push(ZipLine { from, to }),
            DeviceKind::Teleporter => self.teleporters.push(Teleporter { from, to, two_way }),
            DeviceKind::Jetpack => self.jetpacks.push(Jetpack { centre: from, fuel: power }),
        }
    }

    /// The device of a kind nearest to `point` within [`DEVICE_RANGE_M`].
    pub fn nearest(&self, kind: DeviceKind, point: Vec3) -> Option<Device> {
        let devices = self.devices_of(kind).map(|device| (device.from.distance_squared(point), device));
        let near = devices.filter(|(squared, _)| *squared < DEVICE_RANGE_M * DEVICE_RANGE_M);
        near.min_by(|one, other| one.0.total_cmp(&other.0)).map(|(_, device)| device)
    }

    /// Entrance and exit of the zip line or teleporter that brings `goal` nearest to `point`: the smallest sum of the
    /// distances to the entrance and from the exit, among entrances within [`DEVICE_RANGE_M`].
    pub fn best_transport(&self, point: Vec3, goal: Vec3) -> Option<(Vec3, Vec3)> {
        let kinds = DeviceKind::ALL.iter().filter(|kind| kind.is_transport());
        let sums = kinds.flat_map(|kind| self.devices_of(*kind)).flat_map(Device::entrances).filter_map(|way| {
            let (squared, exit) = (way.from.distance_squared(point), way.to?);
            let is_near = squared <= DEVICE_RANGE_M * DEVICE_RANGE_M;
            is_near.then(|| (squared.sqrt() + exit.distance(goal), (way.from, exit)))
        });
        sums.min_by(|one, other| one.0.total_cmp(&other.0)).map(|(_, ends)| ends)
    }
}
