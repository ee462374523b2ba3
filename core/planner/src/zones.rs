//! Zones: boxes and cylinders of a map in which plans pay for each metre, or which they must not enter.
//!
//! A zone measures the straight line between the two ends of a leg. It changes what plans cost and never what the
//! graph contains, so that zones need no build. [`Router`](crate::Router) applies them to a graph.

use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;
use std::sync::Arc;
use surefoot_world::{Aabb, Vec3};

/// Most zones of a set.
pub const MAX_ZONES: usize = 256;
/// Highest price, in seconds per metre.
pub const MAX_PRICE: f32 = 1000.0;
/// Most characters of a name or a tag.
pub const MAX_NAME_LEN: usize = 64;
/// Most tags of an NPC, of a query or of a zone.
pub const MAX_TAGS: usize = 32;

/// Words that zones ask for, for example keys or teams.
pub type Tags = BTreeSet<String>;

/// The places that a zone contains, its surface included.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub enum Shape {
    /// A box whose sides are parallel to the axes.
    Box(Aabb),
    /// An upright cylinder.
    Cylinder {
        /// Centre of its bottom, m.
        bottom: Vec3,
        /// Radius, m.
        radius: f32,
        /// Height, m.
        height: f32,
    },
}

/// What a zone asks of a plan.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub enum Rule {
    /// Each metre inside counts as so many seconds more, in (0, [`MAX_PRICE`]].
    Price(f32),
    /// No leg leads into the zone.
    Never,
    /// As [`Never`](Self::Never) for NPCs that lack this tag, free for all others.
    OnlyWith(String),
}

/// A part of a map with a rule for plans.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Zone {
    /// Its name, unique in a set.
    pub name: String,
    /// The places inside.
    pub shape: Shape,
    /// What it asks of plans.
    pub rule: Rule,
    /// The zone concerns only NPCs with one of these tags; empty: all NPCs.
    pub concerns: Tags,
}

/// A zone is not usable.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum ZoneError {
    /// A name or a tag is empty or too long.
    #[error("a name and a tag have 1 to {MAX_NAME_LEN} characters")]
    Name,
    /// There are too many tags.
    #[error("there are at most {MAX_TAGS} tags")]
    TagCount,
    /// A size is not positive, or a coordinate is not finite.
    #[error("a zone has finite coordinates and a positive size along each axis")]
    Shape,
    /// The price is out of range.
    #[error("a price is above 0 and at most {MAX_PRICE} s/m")]
    Price,
}

/// Returns these tags.
///
/// # Errors
/// If there are more than [`MAX_TAGS`], or one is empty or has more than [`MAX_NAME_LEN`] characters.
pub fn check_tags(tags: impl IntoIterator<Item = String>) -> Result<Tags, ZoneError> {
    let tags: Tags = tags.into_iter().take(MAX_TAGS + 1).collect();
    if tags.len() > MAX_TAGS {
        return Err(ZoneError::TagCount);
    }
    tags.iter().try_for_each(|tag| check_name(tag))?;
    Ok(tags)
}

fn check_name(name: &str) -> Result<(), ZoneError> {
    if (1..=MAX_NAME_LEN).contains(&name.chars().count()) { Ok(()) } else { Err(ZoneError::Name) }
}

impl Shape {
    /// The smallest box around it.
    pub fn bounds(&self) -> Aabb {
        match *self {
            Self::Box(extent) => extent,
            Self::Cylinder { bottom, radius, height } => {
                let side = Vec3::new(radius, 0.0, radius);
                Aabb { low: bottom - side, high: bottom + side + Vec3::Y * height }
            }
        }
    }

    /// Returns whether `place`, m, is inside.
    pub fn contains(&self, place: Vec3) -> bool {
        let bounds = self.bounds();
        let in_bounds = place.cmpge(bounds.low).all() && place.cmple(bounds.high).all();
        match *self {
            Self::Box(_) => in_bounds,
            Self::Cylinder { bottom, radius, .. } => {
                let (x, z) = (place.x - bottom.x, place.z - bottom.z);
                in_bounds && x * x + z * z <= radius * radius
            }
        }
    }

    /// Returns the length of the part of a straight line that is inside, m; `None` if no part is.
    pub fn length_inside(&self, from: Vec3, to: Vec3) -> Option<f32> {
        let way = to - from;
        let bounds = self.bounds();
        let mut part = (0.0, 1.0);
        for axis in 0..3 {
            part = slab(part, [from[axis], way[axis]], [bounds.low[axis], bounds.high[axis]])?;
        }
        if let Self::Cylinder { bottom, radius, .. } = *self {
            part = disc(part, [from.x - bottom.x, from.z - bottom.z], [way.x, way.z], radius)?;
        }
        Some((part.1 - part.0) * way.length())
    }
}

/// The part of a line between two fractions of its length at which a coordinate, which starts at `at` and changes by
/// `by`, is in a range.
fn slab((first, last): (f32, f32), [at, by]: [f32; 2], [low, high]: [f32; 2]) -> Option<(f32, f32)> {
    if by == 0.0 {
        return (low..=high).contains(&at).then_some((first, last));
    }
    let (enters, leaves) = ((low - at) / by, (high - at) / by);
    let (first, last) = (first.max(enters.min(leaves)), last.min(enters.max(leaves)));
    (first <= last).then_some((first, last))
}

/// Like [`slab`], for the part inside a disc of this radius around the origin.
fn disc((first, last): (f32, f32), [x, z]: [f32; 2], [dx, dz]: [f32; 2], radius: f32) -> Option<(f32, f32)> {
    let square = dx * dx + dz * dz;
    let beyond = x * x + z * z - radius * radius;
    if square == 0.0 {
        return (beyond <= 0.0).then_some((first, last));
    }
    let nearest = -(x * dx + z * dz) / square;
    let half = (nearest * nearest - beyond / square).max(-1.0);
    if half < 0.0 {
        return None;
    }
    let half = half.sqrt();
    let (first, last) = (first.max(nearest - half), last.min(nearest + half));
    (first <= last).then_some((first, last))
}

impl Zone {
    /// Returns this zone.
    ///
    /// # Errors
    /// If a number is out of range, or the name or a tag is empty or too long.
    pub fn check(self) -> Result<Self, ZoneError> {
        check_name(&self.name)?;
        let Aabb { low, high } = self.shape.bounds();
        let is_sized = match self.shape {
            Shape::Box(_) => low.cmplt(high).all(),
            Shape::Cylinder { radius, height, .. } => radius > 0.0 && height > 0.0,
        };
        if !is_sized || !low.is_finite() || !high.is_finite() {
            return Err(ZoneError::Shape);
        }
        match &self.rule {
            Rule::Price(price) if !(*price > 0.0 && *price <= MAX_PRICE) => return Err(ZoneError::Price),
            Rule::OnlyWith(tag) => check_name(tag)?,
            Rule::Price(_) | Rule::Never => {}
        }
        check_tags(self.concerns.iter().cloned())?;
        Ok(self)
    }

    /// Returns whether the zone binds an NPC with these tags.
    pub fn binds(&self, tags: &Tags) -> bool {
        let is_concerned = self.concerns.is_empty() || !self.concerns.is_disjoint(tags);
        is_concerned && !matches!(&self.rule, Rule::OnlyWith(tag) if tags.contains(tag))
    }

    /// The price in seconds per metre; `None` if plans must not enter.
    pub fn price(&self) -> Option<f32> {
        match self.rule {
            Rule::Price(price) => Some(price),
            Rule::Never | Rule::OnlyWith(_) => None,
        }
    }

    /// Adds what decides plans to a hash.
    fn hash(&self, hasher: &mut blake3::Hasher) {
        let numbers = match self.shape {
            Shape::Box(Aabb { low, high }) => [0.0, low.x, low.y, low.z, high.x, high.y, high.z],
            Shape::Cylinder { bottom, radius, height } => [1.0, bottom.x, bottom.y, bottom.z, radius, height, 0.0],
        };
        numbers.iter().chain(&[self.price().unwrap_or(0.0)]).for_each(|it| _ = hasher.update(&it.to_le_bytes()));
        let only_with = if let Rule::OnlyWith(tag) = &self.rule { tag } else { "" };
        for word in self.concerns.iter().map(String::as_str).chain([only_with]) {
            hasher.update(&(word.len() as u32).to_le_bytes()).update(word.as_bytes());
        }
        hasher.update(&[u8::MAX; 4]);
    }
}

/// A set of zones. Copies are cheap.
#[derive(Debug, Clone)]
pub struct Zones {
    zones: Arc<[Zone]>,
    bounds: Arc<[Aabb]>,
    /// Whether any zone asks for tags.
    has_tags: bool,
    hash: blake3::Hash,
}

impl Zones {
    /// Creates a set of checked zones, of which the first [`MAX_ZONES`] count.
    pub fn new(zones: impl IntoIterator<Item = Zone>) -> Self {
        let zones: Arc<[Zone]> = zones.into_iter().take(MAX_ZONES).collect();
        let mut hasher = blake3::Hasher::new();
        zones.iter().for_each(|zone| zone.hash(&mut hasher));
        Self {
            bounds: zones.iter().map(|zone| zone.shape.bounds()).collect(),
            has_tags: zones.iter().any(|zone| !zone.concerns.is_empty() || matches!(zone.rule, Rule::OnlyWith(_))),
            hash: hasher.finalize(),
            zones,
        }
    }

    /// Returns whether there is no zone.
    pub fn is_empty(&self) -> bool {
        self.zones.is_empty()
    }

    /// Iterates over the zones in their order.
    pub fn iter(&self) -> impl Iterator<Item = &Zone> {
        self.zones.iter()
    }

    /// The zones, by index.
    pub(crate) fn all(&self) -> &[Zone] {
        &self.zones
    }

    /// The smallest box around each zone.
    pub(crate) fn bounds(&self) -> &[Aabb] {
        &self.bounds
    }

    /// The zones that bind NPCs with these tags.
    pub(crate) fn binding(&self, tags: &Tags) -> ZoneMask {
        let mut mask = ZoneMask::all(self.zones.len());
        if self.has_tags {
            (0..).zip(&*self.zones).filter(|(_, zone)| !zone.binds(tags)).for_each(|(idx, _)| mask.remove(idx));
        }
        mask
    }

    /// Returns whether a leg between two places, m, leads into or through a zone that NPCs with these tags must not
    /// enter, from outside of it.
    pub fn bars(&self, tags: &Tags, [from, to]: [Vec3; 2]) -> bool {
        self.iter().any(|zone| {
            let is_entered = zone.price().is_none() && zone.shape.length_inside(from, to).is_some();
            is_entered && !zone.shape.contains(from) && zone.binds(tags)
        })
    }
}

impl Default for Zones {
    fn default() -> Self {
        static NONE: std::sync::LazyLock<Zones> = std::sync::LazyLock::new(|| Zones::new([]));
        NONE.clone()
    }
}

impl PartialEq for Zones {
    fn eq(&self, other: &Self) -> bool {
        self.hash == other.hash && self.zones == other.zones
    }
}

/// Some zones of a set.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) struct ZoneMask([u64; MAX_ZONES / 64]);

impl ZoneMask {
    fn all(count: usize) -> Self {
        let mut mask = Self::default();
        (0..count).for_each(|idx| mask.insert(idx));
        mask
    }

    pub fn insert(&mut self, idx: usize) {
        self.0[idx / 64] |= 1 << (idx % 64);
    }

    fn remove(&mut self, idx: usize) {
        self.0[idx / 64] &= !(1 << (idx % 64));
    }

    pub fn contains(self, idx: usize) -> bool {
        self.0[idx / 64] & 1 << (idx % 64) != 0
    }

    pub fn is_empty(self) -> bool {
        self == Self::default()
    }
}

/// Which plans cost the same: those with equal zones, of which the same bind and are left.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct ZonesKey {
    hash: blake3::Hash,
    /// The zones that bind the NPC.
    pub binding: ZoneMask,
    /// The zones that plans must not enter and that contain the start.
    pub left: ZoneMask,
}

impl ZonesKey {
    pub fn new(zones: &Zones, binding: ZoneMask, left: ZoneMask) -> Self {
        Self { hash: zones.hash, binding, left }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn place() -> impl Strategy<Value = Vec3> {
        (-9.0..9.0f32, -9.0..9.0f32, -9.0..9.0f32).prop_map(|(x, y, z)| Vec3::new(x, y, z))
    }

    fn shape() -> impl Strategy<Value = Shape> {
        let cuboid = (place(), place())
            .prop_map(|(one, other)| Shape::Box(Aabb { low: one.min(other), high: one.max(other) + Vec3::splat(0.1) }));
        let cylinder = (place(), 0.1..6.0f32, 0.1..9.0f32);
        let cylinder = cylinder.prop_map(|(bottom, radius, height)| Shape::Cylinder { bottom, radius, height });
        prop_oneof![cuboid, cylinder]
    }

    proptest! {
        #![proptest_config(crate::properties::cases(300))]

        #[test]
        fn the_length_inside_is_the_share_of_the_places_on_a_leg_that_are_inside(
            shape in shape(),
            (from, to) in (place(), place()),
            still in (any::<bool>(), any::<bool>(), any::<bool>()),
        ) {
            // Legs along an axis, and legs without length, are among them.
            let keep = [still.0, still.1, still.2];
            let to = Vec3::from(std::array::from_fn(|axis| if keep[axis] { from[axis] } else { to[axis] }));
            const SAMPLES: u32 = 4000;
            let at = |sample: u32| from + (to - from) * ((sample as f32 + 0.5) / SAMPLES as f32);
            let inside = (0..SAMPLES).filter(|sample| shape.contains(at(*sample))).count();
            let share = inside as f32 / SAMPLES as f32;
            let length = shape.length_inside(from, to);
            prop_assert!((length.unwrap_or(0.0) - share * from.distance(to)).abs() < 0.03, "{length:?}, not {share}");
            prop_assert!(inside == 0 || length.is_some());
            prop_assert!(!shape.contains(from) || length.is_some());
        }
    }

    #[test]
    fn zones_out_of_range_are_refused() {
        let zone = |shape, rule| Zone { name: "zone".to_owned(), shape, rule, concerns: Tags::new() }.check().map(drop);
        let cube = Shape::Box(Aabb { low: Vec3::ZERO, high: Vec3::ONE });
        assert_eq!(zone(cube, Rule::Price(MAX_PRICE)), Ok(()));
        for price in [0.0, -1.0, f32::NAN, f32::INFINITY, MAX_PRICE * 1.1] {
            assert_eq!(zone(cube, Rule::Price(price)), Err(ZoneError::Price));
        }
        let flat = Shape::Box(Aabb { low: Vec3::ZERO, high: Vec3::X });
        let thin = Shape::Cylinder { bottom: Vec3::ZERO, radius: 0.0, height: 2.0 };
        let far = Shape::Cylinder { bottom: Vec3::splat(f32::NAN), radius: 1.0, height: 2.0 };
        for shape in [flat, thin, far] {
            assert_eq!(zone(shape, Rule::Never), Err(ZoneError::Shape));
        }
        assert_eq!(zone(cube, Rule::OnlyWith(String::new())), Err(ZoneError::Name));
        assert_eq!(check_tags((0..=MAX_TAGS).map(|idx| idx.to_string())), Err(ZoneError::TagCount));
        assert_eq!(check_tags(["x".repeat(MAX_NAME_LEN + 1)]), Err(ZoneError::Name));
    }

    #[test]
    fn tags_open_zones_and_choose_whom_they_concern() {
        let tags = |tags: &[&str]| -> Tags { tags.iter().map(|tag| (*tag).to_owned()).collect() };
        let shape = Shape::Box(Aabb { low: Vec3::ZERO, high: Vec3::ONE });
        let zone = |rule, concerns: &[&str]| Zone { name: "zone".to_owned(), shape, rule, concerns: tags(concerns) };
        let door = zone(Rule::OnlyWith("key".to_owned()), &[]);
        assert!(door.binds(&tags(&[])) && door.binds(&tags(&["red"])) && !door.binds(&tags(&["key", "red"])));
        let base = zone(Rule::Never, &["red", "green"]);
        assert!(!base.binds(&tags(&[])) && base.binds(&tags(&["green"])) && !base.binds(&tags(&["blue"])));
    }
}
