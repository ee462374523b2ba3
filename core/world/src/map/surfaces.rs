//! Surfaces that rays hit and bodies pass through: those of pools and the discs of devices.

use super::device::Device;
use super::features::{DISC_RADIUS_M, Outline, Placed, Pool};
use crate::Vec3;
use crate::mesh::{Surface, Triangle};
use std::f32::consts::TAU;

/// Height of a device's disc above the device's centre, m.
const DISC_LIFT_M: f32 = 0.12;
/// Number of triangles of a disc.
const DISC_SIDES: usize = 16;

/// Adds what rays hit and bodies pass through: surfaces of pools and discs of devices.
pub(super) fn add(placed: &Placed, triangles: &mut Vec<Triangle>) {
    add_pools(&placed.pools, triangles);
    let lift = Vec3::new(0.0, DISC_LIFT_M, 0.0);
    for entrance in placed.devices().flat_map(Device::entrances) {
        add_disc(triangles, entrance.from + lift, DISC_RADIUS_M, entrance.kind.surface());
    }
}

/// Adds the surfaces of pools.
pub(super) fn add_pools(pools: &[Pool], triangles: &mut Vec<Triangle>) {
    for pool in pools {
        let surface = pool.liquid.into();
        match pool.outline {
            Outline::Round { radius } => add_disc(triangles, pool.centre, radius, surface),
            Outline::Rectangle { half_x, half_z } => {
                let corner = |x: f32, z: f32| pool.centre + Vec3::new(x * half_x, 0.0, z * half_z);
                let [a, b, c, d] = [corner(-1.0, -1.0), corner(-1.0, 1.0), corner(1.0, 1.0), corner(1.0, -1.0)];
                triangles.extend([[a, b, c], [a, c, d]].into_iter().filter_map(|t| Triangle::new(t, surface)));
            }
        }
    }
}

/// Adds a horizontal disc as a triangle fan that faces up.
fn add_disc(triangles: &mut Vec<Triangle>, centre: Vec3, radius: f32, surface: Surface) {
    let rim = |i: usize| {
        let (sin, cos) = libm::sincosf(i as f32 * TAU / DISC_SIDES as f32);
        centre + Vec3::new(sin * radius, 0.0, cos * radius)
    };
    triangles.extend((0..DISC_SIDES).filter_map(|i| Triangle::new([centre, rim(i), rim(i + 1)], surface)));
}
