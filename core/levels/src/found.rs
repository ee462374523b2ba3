//! The features of a level, from its nodes and its sidecar, before they are placed on the map.

use crate::extras::{Extras, property};
use crate::faults::ImportError;
use crate::meaning::{Kind, Meaning};
use crate::moving::{self, Paths};
use crate::pairs::{Half, Paired, Pairs};
use crate::scene::{Node, node_label};
use crate::upright::upright_box;
use surefoot_world::map::mover::MAX_MOVERS;
use surefoot_world::map::spec::MAX_HEIGHT_M;
use surefoot_world::map::{
    Device, DeviceKind, Liquid, MapSize, Mover, MoverError, Outline, Placed, Pool, Spot, features,
};
use surefoot_world::{Aabb, Vec3};

/// Constants of pads in `f64`, like the numbers of JSON.
pub(super) const PAD_GRAVITY: f64 = features::PAD_GRAVITY as f64;
pub(super) const PAD_EXTRA_M: f64 = features::PAD_EXTRA_M as f64;
/// Default rise for which a pad is there, m.
const PAD_HEIGHT_M: f64 = 4.0;
/// Height of a node below which its pool counts as flat, m.
const FLAT_M: f32 = 0.01;
/// Distance outside the map that counts as a rounding error, m.
const ROUNDING_M: f32 = 0.01;

/// The features found, in metres before the shift onto the map, each with its name for messages.
#[derive(Default)]
pub(super) struct Found {
    pub(super) pools: Vec<(String, FoundPool)>,
    pub(super) devices: Vec<(String, Device)>,
    pub(super) spots: Vec<(String, Spot)>,
    pub(super) movers: Vec<Mover>,
    /// Triangles that bodies climb.
    pub(super) climbs: Vec<[Vec3; 3]>,
    /// The box around the devices and movers that are nodes: parts of the level, unlike entries of the sidecar.
    pub(super) reach: Option<Aabb>,
}

pub(super) struct FoundPool {
    pub(super) liquid: Liquid,
    pub(super) bounds: Aabb,
    /// Radius of a round pool, m; `None` for a rectangle.
    pub(super) radius: Option<f32>,
}

impl Found {
    /// Adds the features that nodes stand for; `owners` are those of [`named::owners`](crate::named::owners).
    pub(super) fn add_nodes(
        &mut self,
        nodes: &[Node],
        meanings: &[Meaning],
        owners: &[Option<usize>],
        paths: &Paths,
    ) -> Result<(), ImportError> {
        let bounds = feature_bounds(nodes, owners);
        let mut triangles_of: Vec<Vec<[Vec3; 3]>> = vec![Vec::new(); nodes.len()];
        for (node, owner) in nodes.iter().zip(owners) {
            if let Some(owner) =
                owner.filter(|owner| matches!(meanings[*owner].kind, Some(Kind::Mover(_) | Kind::Ladder | Kind::Climb)))
            {
                triangles_of[owner].extend_from_slice(&node.triangles);
            }
        }
        let mut pairs = Pairs::default();
        for (idx, (node, meaning)) in nodes.iter().zip(meanings).enumerate() {
            let Some(kind) = meaning.kind.as_ref().filter(|_| owners[idx] == Some(idx)) else { continue };
            let bounds = bounds[idx].unwrap_or(Aabb::at(node.origin));
            let at = bounds.bottom();
            let name = node_label(&node.name, node.file_idx);
            let extras = Extras::new(node, &name)?;
            match kind {
                Kind::Pool(liquid) => {
                    let pool = FoundPool { liquid: *liquid, bounds, radius: extras.radius()? };
                    self.pools.push((name, pool));
                }
                Kind::Device(kind, end) => {
                    self.extend(at);
                    match end {
                        Some((end, pair)) => {
                            let two_way =
                                *kind == DeviceKind::Teleporter && extras.flag("two_way")?.unwrap_or_default();
                            let kind = Paired::Device(*kind);
                            pairs.add(pair.clone(), *end, Half { node, kind, at, two_way });
                        }
                        None => {
                            let power = power(*kind, |key| extras.number(key), &name)?;
                            self.devices.push((name, Device { power, ..Device::new(*kind, at) }));
                        }
                    }
                }
                Kind::Spot(tag, end) => {
                    self.extend(at);
                    match end {
                        Some((end, pair)) => {
                            let two_way = extras.flag("two_way")?.unwrap_or_default();
                            let kind = Paired::Spot(tag.clone());
                            pairs.add(pair.clone(), *end, Half { node, kind, at, two_way });
                        }
                        None => {
                            let from = bounds.low.midpoint(bounds.high);
                            self.spots.push((name, Spot { tag: tag.clone(), from, to: None, two_way: false }));
                        }
                    }
                }
                Kind::Mover(kind) => {
                    let triangles = std::mem::take(&mut triangles_of[idx]);
                    let Some(mut mover) = moving::from_node(*kind, node, &extras, paths, triangles)? else { continue };
                    mover.name = moving::distinct_name(&node.name, idx, &self.movers);
                    if self.movers.len() >= MAX_MOVERS {
                        return Err(MoverError::TooMany(self.movers.len() + 1).into());
                    }
                    mover.triangles.iter().flatten().for_each(|corner| self.extend(*corner));
                    self.movers.push(mover);
                }
                Kind::Ladder | Kind::Climb => {
                    let triangles = std::mem::take(&mut triangles_of[idx]);
                    let climbs = if *kind == Kind::Climb { triangles } else { upright_box(triangles.as_flattened()) };
                    climbs.iter().flatten().for_each(|corner| self.extend(*corner));
                    self.climbs.extend(climbs);
                }
                Kind::Path | Kind::Helper | Kind::LeftOut => {}
            }
        }
        for (name, kind, [from, to], two_way) in pairs.finish() {
            match kind {
                Paired::Device(kind) => {
                    self.devices.push((name, Device { to: Some(to), two_way, ..Device::new(kind, from) }));
                }
                Paired::Spot(tag) => self.spots.push((name, Spot { tag, from, to: Some(to), two_way })),
            }
        }
        Ok(())
    }

    fn extend(&mut self, point: Vec3) {
        let point = Aabb::at(point);
        self.reach = Some(self.reach.map_or(point, |reach| reach.union(point)));
    }

    /// Lowest and highest y of all pools, m; infinite if there are none.
    pub(super) fn pool_heights(&self) -> (f32, f32) {
        let heights = self.pools.iter().map(|(_, pool)| (pool.bounds.low.y, pool.bounds.high.y));
        heights.fold((f32::INFINITY, f32::NEG_INFINITY), |(low, high), (l, h)| (low.min(l), high.max(h)))
    }

    pub(super) fn flat_pool_count(&self) -> usize {
        self.pools.iter().filter(|(_, pool)| pool.bounds.high.y - pool.bounds.low.y < FLAT_M).count()
    }

    /// Takes the movers, shifted onto the map.
    pub(super) fn take_movers(&mut self, shift: Vec3) -> Vec<Mover> {
        let moved = |mover: Mover| Mover {
            triangles: mover.triangles.iter().map(|corners| corners.map(|corner| corner + shift)).collect(),
            pivot: mover.pivot + shift,
            ..mover
        };
        std::mem::take(&mut self.movers).into_iter().map(moved).collect()
    }

    /// Shifts all features onto the map and clips pools at its rim; `Err` is the name of a feature that lies outside.
    pub(super) fn place(self, shift: Vec3, size: MapSize) -> Result<Placed, String> {
        let extent = size.extent();
        let on_map = |name: &String, point: Vec3| {
            let point = point + shift;
            let slack = Vec3::splat(ROUNDING_M);
            let is_inside = point.cmpge(-slack).all() && point.cmple(extent + slack).all();
            if is_inside { Ok(point) } else { Err(name.clone()) }
        };
        let mut placed = Placed::default();
        for (name, pool) in self.pools {
            placed.pools.push(pool.place(shift, extent).ok_or(name)?);
        }
        for (name, device) in self.devices {
            let to = device.to.map(|to| on_map(&name, to)).transpose()?;
            placed.add(Device { from: on_map(&name, device.from)?, to, ..device });
        }
        for (name, spot) in self.spots {
            let to = spot.to.map(|to| on_map(&name, to)).transpose()?;
            placed.spots.push(Spot { from: on_map(&name, spot.from)?, to, ..spot });
        }
        Ok(placed)
    }
}

/// The box around each feature node with what belongs to it; `None` if it has no triangles.
fn feature_bounds(nodes: &[Node], owners: &[Option<usize>]) -> Vec<Option<Aabb>> {
    let mut bounds: Vec<Option<Aabb>> = vec![None; nodes.len()];
    for (node, owner) in nodes.iter().zip(owners) {
        if let (Some(owner), Some(own)) = (*owner, Aabb::around(node.triangles.iter().flatten().copied())) {
            bounds[owner] = Some(bounds[owner].map_or(own, |bounds| bounds.union(own)));
        }
    }
    bounds
}

impl FoundPool {
    fn place(&self, shift: Vec3, extent: Vec3) -> Option<Pool> {
        let Aabb { low, high } = self.bounds;
        let (low, high) = (low + shift, high + shift);
        // The bottom may lie below the map, but no pool is deeper than the highest map.
        let depth = (high.y - low.y).min(MAX_HEIGHT_M as f32);
        let (low, high) = match self.radius {
            Some(_) => (low, high),
            None => (
                Vec3::new(low.x.max(0.0), low.y, low.z.max(0.0)),
                Vec3::new(high.x.min(extent.x), high.y, high.z.min(extent.z)),
            ),
        };
        let half = (high - low) * 0.5;
        let middle = (low + high) * 0.5;
        let centre = Vec3::new(middle.x, high.y, middle.z);
        // These comparisons are false for NaN.
        let is_on_map = half.x > 0.0
            && half.z > 0.0
            && centre.cmpge(Vec3::ZERO).all()
            && centre.cmple(extent).all()
            && self.radius.is_none_or(|radius| radius <= extent.x.max(extent.z));
        let outline = match self.radius {
            Some(radius) => Outline::Round { radius },
            None => Outline::Rectangle { half_x: half.x, half_z: half.z },
        };
        is_on_map.then_some(Pool { centre, outline, depth, liquid: self.liquid })
    }
}

/// What a device gives according to its `height` or `fuel`, which `number` reads.
pub(super) fn power(
    kind: DeviceKind,
    number: impl Fn(&'static str) -> Result<Option<f64>, ImportError>,
    of: &str,
) -> Result<f32, ImportError> {
    match kind {
        DeviceKind::Pad => pad_speed(number("height")?, of),
        DeviceKind::Jetpack => jetpack_fuel(number("fuel")?, of),
        DeviceKind::ZipLine | DeviceKind::Teleporter => Ok(0.0),
    }
}

/// Upward speed of a pad for a rise of `height` metres, m/s: it throws [`PAD_EXTRA_M`] higher.
fn pad_speed(height: Option<f64>, of: &str) -> Result<f32, ImportError> {
    let height = height.unwrap_or(PAD_HEIGHT_M);
    if !(-PAD_EXTRA_M..=1000.0).contains(&height) {
        return Err(property(of, "height", height, "must be -10 to 1000 m"));
    }
    Ok((2.0 * PAD_GRAVITY * (height + PAD_EXTRA_M)).sqrt() as f32)
}

/// Thrust of a jetpack, s.
fn jetpack_fuel(fuel: Option<f64>, of: &str) -> Result<f32, ImportError> {
    let fuel = fuel.unwrap_or(f64::from(features::JETPACK_FUEL_S));
    if (0.0..=600.0).contains(&fuel) { Ok(fuel as f32) } else { Err(property(of, "fuel", fuel, "must be 0 to 600 s")) }
}
