//! Collision of a body with geometry: integrate in small steps, push out of the deepest contact, follow ground that
//! falls away.

use super::body::{Body, Hold, Support};
use super::profile::CharacterProfile;
use super::surroundings::{MoveScratch, Slope};
use crate::mesh::{Contact, Mesh, Surface};
use crate::{TICK_SECONDS, Vec3};

/// Longest move between two contact passes, m, of a capsule with a radius of [`SUBSTEP_RADIUS_M`] or more. It is
/// proportionally shorter for slimmer capsules: below the radius, so that no body tunnels.
const SUBSTEP_M: f32 = 0.22;
const SUBSTEP_RADIUS_M: f32 = 0.3;
/// Contact passes after each move.
const MAX_PUSHES: usize = 6;
/// Share of the radius up to which the round sole of a capsule slides onto steps by itself.
const SOLE_SHARE: f32 = 0.5;
/// Least move of a body onto a higher step, in radii: its sole must find level ground there.
const TOE_RADII: f32 = 0.5;
/// Share of its speed that a body must lose in a tick before it tries to climb, and its least speed, m/s.
const LOST_SHARE: f32 = 0.3;
const CLIMB_SPEED: f32 = 0.3;
/// Depth of a contact that does not block a body which climbs, m, and longest move down between two contact passes, m.
const CLIMB_SLOP_M: f32 = 0.02;
const DESCENT_M: f32 = 0.05;
/// Least horizontal part of the normal of a face that bodies climb: flatter ones are slopes.
const LEAST_SIDEWAYS: f32 = 0.5;
/// How far ahead of its rim a body looks for something to duck under, m, and where on its rim, as a share of its
/// radius.
const DUCK_M: f32 = 0.25;
const RIM_SHARE: f32 = 0.9;
/// Least downward component of the normal of such a face.
const CEILING: f32 = 0.3;
/// Share of its height to which a body that floats is under water.
pub(super) const FLOAT_SHARE: f32 = 0.75;
/// Height above the water to which a body that swims pulls itself up, m.
const OUT_OF_WATER_M: f32 = 0.7;
/// How far behind the face that it touches a body looks for a ledge, m, and how deep it may be in what is around it.
const LEDGE_M: f32 = 0.05;
const LEDGE_SLOP_M: f32 = 0.05;
/// Speed below which a body wedged between steep faces counts as standing, m/s.
const WEDGED_SPEED: f32 = 0.6;
/// Share of its fall that such a body still falls, at most.
const HELD_SHARE: f32 = 0.2;

impl Body {
    pub(super) fn move_and_collide(&mut self, mesh: &Mesh, profile: &CharacterProfile, scratch: &mut MoveScratch) {
        let was_grounded = self.is_grounded();
        let slope = scratch.slope(profile);
        let before = *self;
        let start = before.feet;
        let delta = self.velocity * TICK_SECONDS;
        let snap = if was_grounded {
            profile.step_height + Vec3::new(delta.x, 0.0, delta.z).length() * slope.tan
        } else {
            0.0
        };
        let reach = Vec3::new(profile.radius + 0.05, 0.05, profile.radius + 0.05);
        let ahead = start + delta;
        let low = start.min(ahead) - reach - Vec3::new(0.0, snap, 0.0);
        let high = start.max(ahead) + reach + Vec3::new(0.0, profile.height + profile.step_height, 0.0);
        scratch.select(mesh, low, high, self.velocity);

        self.support = Support::Air;
        self.hold = None;
        let substep = SUBSTEP_M * (profile.radius / SUBSTEP_RADIUS_M).min(1.0);
        let substep_count = (delta.length() / substep).ceil().max(1.0);
        for _ in 0..substep_count as u32 {
            self.feet += self.velocity * (TICK_SECONDS / substep_count);
            self.push_out(profile, slope, scratch, was_grounded);
        }
        if was_grounded && self.velocity.y <= 0.0 && profile.step_height > SOLE_SHARE * profile.radius {
            self.climb(mesh, profile, scratch, before);
        }
        if was_grounded && self.support != Support::Ground && self.velocity.y <= 0.0 {
            self.snap_down(profile, slope, scratch, snap);
        }
        let is_slow = || (self.feet - start).length() < WEDGED_SPEED * TICK_SECONDS;
        // At the top of a jump along a wall, a body is slow as well, but nothing holds it.
        let is_held = || was_grounded || delta.y < 0.0 && self.feet.y - start.y > HELD_SHARE * delta.y;
        if self.support == Support::Steep && is_slow() && is_held() {
            self.support = Support::Ground;
        }
        if self.is_grounded() {
            self.ticks_in_air = 0;
            self.air_jumps_left = profile.extra_jumps;
            self.has_dashed = false;
            self.wall_ticks = 0;
        } else {
            self.ticks_in_air = self.ticks_in_air.saturating_add(1);
        }
    }

    /// Moves the body out of geometry, deepest contact first, and removes the blocked part of its velocity.
    fn push_out(&mut self, profile: &CharacterProfile, slope: Slope, scratch: &MoveScratch, was_grounded: bool) {
        for _ in 0..MAX_PUSHES {
            let Some(contact) = scratch.deepest_contact(profile, self.feet) else { return };
            let n = contact.normal;
            if is_walkable(profile, slope, &contact, self.feet) {
                self.feet.y += contact.depth / n.y;
                self.velocity.y = self.velocity.y.max(0.0);
                self.support = Support::Ground;
                continue;
            }
            let sideways = Vec3::new(n.x, 0.0, n.z);
            let sideways_length = sideways.length();
            let is_climbed = contact.surface == Surface::Climb && profile.climb_speed > 0.0;
            let holds = profile.mantle_height > 0.0 || profile.wall_run_seconds > 0.0;
            if (is_climbed || holds || self.swims || self.pulls_to.is_some()) && sideways_length > LEAST_SIDEWAYS {
                self.hold = Some(Hold { out: sideways / sideways_length, is_climbed });
            }
            if n.y > 0.0 && sideways_length > 1.0e-3 {
                let out = sideways / sideways_length;
                if self.support == Support::Air && !is_climbed {
                    self.support = Support::Steep;
                    self.steep_out = out;
                }
                if was_grounded || self.support == Support::Ground {
                    // To a walking body a steep face is a wall, not a ramp.
                    self.feet += out * (contact.depth / sideways_length.max(0.2));
                    self.velocity -= out * self.velocity.dot(out).min(0.0);
                    continue;
                }
            }
            self.feet += n * contact.depth;
            let rise = self.velocity.y.max(0.0);
            self.velocity -= n * self.velocity.dot(n).min(0.0);
            self.velocity.y = self.velocity.y.min(rise);
        }
    }

    /// Moves the body by `offset` metres, as far as the geometry allows.
    pub(crate) fn shove(&mut self, mesh: &Mesh, profile: &CharacterProfile, offset: Vec3, scratch: &mut MoveScratch) {
        let support = self.support;
        let reach = Vec3::splat(profile.radius + 0.05);
        let (low, high) = (self.feet.min(self.feet + offset) - reach, self.feet.max(self.feet + offset) + reach);
        scratch.select(mesh, low, high + Vec3::new(0.0, profile.height, 0.0), Vec3::ZERO);
        self.feet += offset;
        let slope = scratch.slope(profile);
        self.push_out(profile, slope, scratch, support == Support::Ground);
        self.support = support;
    }

    /// Takes a walking body onto a step that blocks it and is too high for its sole: up, ahead, and down to the ground.
    /// `before` is the body before its move.
    fn climb(&mut self, mesh: &Mesh, profile: &CharacterProfile, scratch: &mut MoveScratch, before: Self) {
        let wish = Vec3::new(before.velocity.x, 0.0, before.velocity.z);
        let (speed, along) = (wish.length(), wish.normalize_or_zero());
        if speed < CLIMB_SPEED || self.velocity.dot(along) > (1.0 - LOST_SHARE) * speed {
            return;
        }
        // From where the step has stopped the body.
        let here = self.feet.with_y(before.feet.y);
        let left = speed * TICK_SECONDS - (here - before.feet).dot(along);
        let there = here + along * left.max(TOE_RADII * profile.radius);
        let raised = Vec3::Y * profile.step_height;
        let reach = Vec3::splat(profile.radius + 0.05);
        let (low, high) = (here.min(there) - reach, here.max(there) + reach + raised);
        scratch.select(mesh, low, high + Vec3::Y * profile.height, wish);
        let slope = scratch.slope(profile);
        let is_free =
            |feet: Vec3| scratch.deepest_contact(profile, feet).is_none_or(|contact| contact.depth <= CLIMB_SLOP_M);
        if ![here, here.midpoint(there), there].into_iter().all(|feet| is_free(feet + raised)) {
            return;
        }
        let passes = (profile.step_height / DESCENT_M).ceil();
        let mut contacts = (1..=passes as u32).filter_map(|pass| {
            let feet = there + raised * (1.0 - pass as f32 / passes);
            scratch.deepest_contact(profile, feet).map(|contact| (feet, contact))
        });
        if let Some((feet, contact)) = contacts.next()
            && is_walkable(profile, slope, &contact, feet)
        {
            self.feet = feet + Vec3::Y * (contact.depth / contact.normal.y);
            self.velocity = wish;
            self.support = Support::Ground;
        }
    }

    /// Whether something above the body, or ahead where it wants to go, is too low to stand under, so that a body that
    /// can crouch does.
    pub(super) fn is_under_ceiling(&self, mesh: &Mesh, profile: &CharacterProfile, wish: Vec3) -> bool {
        let low = profile.crouch_height - profile.radius;
        self.ceiling(mesh, profile, wish, low, profile.height).is_some()
    }

    /// Height above its feet of the lowest ceiling above the body, or ahead where it wants to go, m: one between two
    /// heights above its feet.
    pub(super) fn ceiling(
        &self,
        mesh: &Mesh,
        profile: &CharacterProfile,
        wish: Vec3,
        low: f32,
        high: f32,
    ) -> Option<f32> {
        let ahead = wish.normalize_or_zero();
        let (far, aside) = (profile.radius + DUCK_M, Vec3::new(-ahead.z, 0.0, ahead.x) * RIM_SHARE);
        let around = [Vec3::ZERO, Vec3::X, Vec3::NEG_X, Vec3::Z, Vec3::NEG_Z].map(|it| it * RIM_SHARE * profile.radius);
        let before = [-aside, Vec3::ZERO, aside].map(|it| ahead * far + it * profile.radius);
        let heights = around.into_iter().chain(before).filter_map(|offset| {
            let hit = mesh.cast_ray(self.feet + offset + Vec3::Y * low, Vec3::Y, high - low)?;
            let is_ceiling =
                hit.surface.is_solid() && mesh.triangles()[hit.triangle_idx as usize].normal().y < -CEILING;
            is_ceiling.then_some(low + hit.distance)
        });
        heights.reduce(f32::min)
    }

    /// Height of the top of the face that the body touches, m, if it is within its reach, with room for the body on it.
    /// `out` is the horizontal unit vector away from the face.
    pub(super) fn ledge(
        &self,
        mesh: &Mesh,
        profile: &CharacterProfile,
        out: Vec3,
        scratch: &mut MoveScratch,
    ) -> Option<f32> {
        let from_water = if self.swims { FLOAT_SHARE * profile.height + OUT_OF_WATER_M } else { 0.0 };
        let reach = profile.mantle_height.max(from_water);
        let above = self.feet - out * (profile.radius + LEDGE_M) + Vec3::Y * reach;
        let least = if self.is_grounded() { profile.step_height } else { 0.0 };
        let hit = mesh.cast_ray(above, Vec3::NEG_Y, reach - least)?;
        let normal = mesh.triangles()[hit.triangle_idx as usize].normal();
        let is_ground = hit.surface.is_solid() && normal.y >= scratch.slope(profile).cos;
        let ledge = above - Vec3::Y * hit.distance;
        (is_ground && is_clear(mesh, profile, ledge, LEDGE_SLOP_M, scratch)).then_some(ledge.y)
    }

    /// Keeps a walking body on ground that falls away; leaves the body in the air over a ledge.
    fn snap_down(&mut self, profile: &CharacterProfile, slope: Slope, scratch: &MoveScratch, snap: f32) {
        let before = *self;
        self.feet.y -= snap;
        self.push_out(profile, slope, scratch, true);
        let moved_sideways = Vec3::new(self.feet.x - before.feet.x, 0.0, self.feet.z - before.feet.z).length();
        if self.support != Support::Ground || self.feet.y > before.feet.y || moved_sideways > 0.5 * profile.radius {
            *self = before;
        }
    }
}

fn is_walkable(profile: &CharacterProfile, slope: Slope, contact: &Contact, feet: Vec3) -> bool {
    contact.normal.y >= slope.cos
        || (contact.face_normal.y >= slope.cos
            && contact.normal.y > 0.5
            && contact.point.y - feet.y <= profile.step_height)
}

/// Whether a body with its feet at `feet`, crouched if it can, is clear of solid geometry, up to `slop` metres of
/// penetration.
///
/// Contacts are one-sided, so the capsule's axis is checked as well: no front face may cross it between sole and crown.
pub fn is_clear(mesh: &Mesh, profile: &CharacterProfile, feet: Vec3, slop: f32, scratch: &mut MoveScratch) -> bool {
    let crouched = (profile.crouch_height > 0.0).then(|| profile.crouched());
    let profile = crouched.as_ref().unwrap_or(profile);
    let up = Vec3::new(0.000_31, 0.999_999_9, 0.000_23);
    let mut from = feet - Vec3::new(0.0, slop, 0.0);
    let crown = feet.y + profile.height;
    while let Some(hit) = mesh.cast_ray(from, up, crown - from.y) {
        let enters = mesh.triangles()[hit.triangle_idx as usize].normal().dot(up) < 0.0;
        if hit.surface.is_solid() && enters && from.y + hit.distance > feet.y - 1.0e-3 {
            return false;
        }
        // The ray hit the ground below, geometry inside it, or a surface that bodies pass.
        from += up * (hit.distance + 1.0e-3);
        if from.y >= crown {
            break;
        }
    }
    let reach = Vec3::new(profile.radius, 0.0, profile.radius);
    scratch.select(mesh, feet - reach, feet + reach + Vec3::new(0.0, profile.height, 0.0), Vec3::ZERO);
    scratch.deepest_contact(profile, feet).is_none_or(|contact| contact.depth <= slop)
}
